#pragma once
#include "base/vec.h"
#include "image/layers.h"

namespace brume {

/// What luminance and CIE-Lab are of the linear RGB that a frame's header names, of Rec. 709 where it names none.
class FrameSpace {
 public:
  FrameSpace();
  /// Chromaticities that are none count as those of Rec. 709.
  explicit FrameSpace(const Layers& frame);

  /// White has 1.
  template <class V>
  auto luminance(const V& rgb) const -> decltype(rgb.x) {
    using T = decltype(rgb.x);
    return T(xyz_from_rgb_[0].y) * rgb.x + T(xyz_from_rgb_[1].y) * rgb.y + T(xyz_from_rgb_[2].y) * rgb.z;
  }
  /// X / X_n, Y, Z / Z_n of linear RGB; white is (1, 1, 1).
  const dmat3& xyz_from_rgb() const { return xyz_from_rgb_; }

 private:
  dmat3 xyz_from_rgb_;
};

}  // namespace brume
