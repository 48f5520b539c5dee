#pragma once
#include <array>
#include <optional>

#include "evaluate/metrics/metric.h"

namespace brume {

/// How much a sequence flickers against its reference, from the frames one after another.
class TemporalError {
 public:
  explicit TemporalError(const LabPolicy& policy) : policy_(policy) {}

  /// The next frame. Two references whose noise is independent take their noise off, as in compare().
  /// @param mask  which pixels count: where this frame's or the one before shows the medium; empty: all
  /// @throws std::logic_error for another size than that of the frame before
  void add(const RgbPlanes& x, const RgbPlanes& reference, const RgbPlanes* second, const Mask& mask);

  struct Result {
    double
        temporal_error;  ///< RMS in CIE-Lab of how the picture changes from frame to frame less how the reference does
    double flicker;      ///< RMS of how the picture changes, less that of the reference; below 0 where a filter smears
    double reference;    ///< RMS of how the reference changes
    int pairs;
  };
  /// Nothing until there are two frames with pixels that count.
  std::optional<Result> result() const;
  /// At every pixel of the frame added last, how far the picture's change since the one before is from the (first)
  /// reference's [Lab]. Nothing after one frame.
  const std::optional<Plane>& last_change() const { return last_change_; }

 private:
  using Lab = std::array<Plane, 3>;
  struct Frame {
    Lab picture, first, second;
    Mask mask;
  };

  LabPolicy policy_;
  std::optional<Frame> last_;
  std::optional<Plane> last_change_;
  double errors_ = 0, changes_ = 0, reference_changes_ = 0;  // sums over pairs of means over pixels
  int pairs_ = 0;
};

}  // namespace brume
