#pragma once
#include <algorithm>

namespace brume {

/// Part of a larger plane.
struct Box {
  int x0, y0, x1, y1;  ///< the last two exclusive
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  Box grown(int by, int image_width, int image_height) const {
    return {std::max(0, x0 - by), std::max(0, y0 - by), std::min(image_width, x1 + by),
            std::min(image_height, y1 + by)};
  }
};

}  // namespace brume
