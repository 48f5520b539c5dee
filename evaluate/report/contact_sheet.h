#pragma once
#include <optional>
#include <string>
#include <vector>

#include "evaluate/metrics/metric.h"
#include "image/picture_io.h"

namespace brume {

/// Frames of a sequence side by side: the picture, the reference, the Lab distance between them, and how far the
/// picture's change since the frame before is from the reference's, in false colour with a key.
class ContactSheet {
 public:
  static constexpr int kMostColumns = 12, kWidestCell = 320;

  /// @param frames  of the sequence; where they are more than the columns, some at even distances are shown
  ContactSheet(const LabPolicy& policy, int frames) : policy_(policy), frames_(frames) {}

  /// The next frame. @param change  TemporalError::last_change; nothing for the first one
  void add(int number, const RgbPlanes& picture, const RgbPlanes& reference, double lab_rms,
           const std::optional<Plane>& change);

  Picture draw() const;

 private:
  struct Column {
    std::string caption;
    Picture picture, reference;
    Plane error, change;  // in Lab; empty for the first frame's change
  };

  LabPolicy policy_;
  int frames_, added_ = 0;
  std::vector<Column> columns_;
};

}  // namespace brume
