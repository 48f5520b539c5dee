#pragma once
#include <vector>

#include "image/plane.h"

namespace brume {

/// A plane whose rows have room on both sides, filled with the edge pixel: window kernels may read `pad()` pixels past
/// either end of a row, and a whole vector past the right one. Rows above and below are the caller's to clip.
class PaddedPlane {
 public:
  PaddedPlane() = default;
  /// @param radius  of the widest window
  PaddedPlane(int width, int height, int radius)
      : width_(width),
        height_(height),
        pad_((radius + kVector + kVector - 1) / kVector * kVector),
        plane_(width + 2 * pad_, height) {}

  int width() const { return width_; }
  int height() const { return height_; }
  float* row(int y) { return plane_.row(y) + pad_; }
  const float* row(int y) const { return plane_.row(y) + pad_; }

  void extend_row(int y) {
    float* r = row(y);
    for (int x = 1; x <= pad_; ++x) {
      r[-x] = r[0];
      r[width_ - 1 + x] = r[width_ - 1];
    }
  }

 private:
  static constexpr int kVector = 16;  // floats in the widest vector
  int width_ = 0, height_ = 0, pad_ = 0;
  Plane plane_;
};

/// Channels of one size, padded alike.
struct WorkImage {
  std::vector<PaddedPlane> channels;
  WorkImage() = default;
  WorkImage(int width, int height, int radius, size_t count) : channels(count, PaddedPlane(width, height, radius)) {}
  int width() const { return channels[0].width(); }
  int height() const { return channels[0].height(); }
  void extend_row(int y) {
    for (PaddedPlane& c : channels) c.extend_row(y);
  }
};

}  // namespace brume
