#pragma once
#include <cstdint>
#include <vector>

#include "base/vec.h"
#include "filters/inputs/planes.h"

namespace brume {

/// Where the pixels of a frame are found in another frame of the sequence, in whole pixels, so that all that a pixel
/// holds stays together.
class Alignment {
 public:
  /// @param shifts  from each pixel to its place in the other frame [px], row by row; those that lead out of the
  /// picture
  ///                find nothing
  Alignment(int width, int height, const std::vector<ivec2>& shifts);

  /// A plane of the other frame on the pixels of this one; `own` where nothing is found.
  Plane bring(const Plane& other, const Plane& own, const Task& task) const;
  void forget(int x, int y) { places_[static_cast<size_t>(y) * width_ + static_cast<size_t>(x)] = kNowhere; }

 private:
  static constexpr int64_t kNowhere = -1;
  size_t width_;
  std::vector<int64_t> places_;  // offsets into a plane, from its first pixel
};

/// Matches blocks of 8 x 8 pixels from coarse to fine by the variance of the difference of windows of 16 x 16. A block
/// at rest stays at rest unless its place elsewhere differs clearly less.
/// @param here, there  what is compared, plane by plane, of like size and weight
Alignment match_blocks(const std::vector<const Plane*>& here, const std::vector<const Plane*>& there, const Task& task);

/// How a frame lies in another: matched by guides where both frames have them, which are free of noise, otherwise by
/// the smoothed brightness of the signal. A pixel around which the signal differs by more than its noise explains,
/// where the frames know their noise, is not found.
Alignment find_alignment(const Layers& here, const Layers& there, const LayerName& signal, const Task& task);

}  // namespace brume
