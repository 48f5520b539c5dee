#include "image/luminance_chroma.h"

#include <algorithm>
#include <cmath>

namespace brume {

std::array<Plane, 3> rgb_from_luminance_chroma(const LuminanceChroma& picture, const std::array<float, 3>& weights) {
  const int width = picture.y.width(), height = picture.y.height();
  std::array<Plane, 3> rgb{Plane(width, height), Plane(width, height), Plane(width, height)};
  for (int row = 0; row < height; ++row)
    for (int x = 0; x < width; ++x) {
      const float y = picture.y(x, row);
      const float red = (picture.ry(x, row) + 1) * y, blue = (picture.by(x, row) + 1) * y;
      rgb[0](x, row) = red;
      rgb[1](x, row) = (y - weights[0] * red - weights[2] * blue) / weights[1];
      rgb[2](x, row) = blue;
    }
  return rgb;
}

LuminanceChroma luminance_chroma_from_rgb(const std::array<const Plane*, 3>& rgb, const std::array<float, 3>& weights) {
  const int width = rgb[0]->width(), height = rgb[0]->height();
  LuminanceChroma picture{Plane(width, height), Plane(width, height), Plane(width, height)};
  for (int row = 0; row < height; ++row)
    for (int x = 0; x < width; ++x) {
      const float red = (*rgb[0])(x, row), green = (*rgb[1])(x, row), blue = (*rgb[2])(x, row);
      const float y = weights[0] * red + weights[1] * green + weights[2] * blue;
      picture.y(x, row) = y;
      if (y == 0) continue;
      picture.ry(x, row) = (red - y) / y;
      picture.by(x, row) = (blue - y) / y;
    }
  return picture;
}

Plane upsampled(const Plane& coarse, int width, int height, int step_x, int step_y) {
  Plane fine(width, height);
  const auto at = [](int position, int step, int count, int& cell, float& share) {
    cell = std::min(position / step, count - 1);
    share = cell + 1 < count ? static_cast<float>(position - cell * step) / static_cast<float>(step) : 0.0f;
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      int i, j;
      float s, t;
      at(x, step_x, coarse.width(), i, s);
      at(y, step_y, coarse.height(), j, t);
      const int i1 = std::min(i + 1, coarse.width() - 1), j1 = std::min(j + 1, coarse.height() - 1);
      const float top = std::lerp(coarse(i, j), coarse(i1, j), s), bottom = std::lerp(coarse(i, j1), coarse(i1, j1), s);
      fine(x, y) = std::lerp(top, bottom, t);
    }
  return fine;
}

Plane downsampled(const Plane& fine, int step_x, int step_y) {
  Plane coarse((fine.width() + step_x - 1) / step_x, (fine.height() + step_y - 1) / step_y);
  for (int j = 0; j < coarse.height(); ++j)
    for (int i = 0; i < coarse.width(); ++i) {
      double sum = 0, weights = 0;
      for (int dy = 1 - step_y; dy < step_y; ++dy)
        for (int dx = 1 - step_x; dx < step_x; ++dx) {
          const int x = i * step_x + dx, y = j * step_y + dy;
          if (x < 0 || y < 0 || x >= fine.width() || y >= fine.height()) continue;
          const double weight = static_cast<double>(step_x - std::abs(dx)) * (step_y - std::abs(dy));
          sum += weight * fine(x, y);
          weights += weight;
        }
      coarse(i, j) = static_cast<float>(sum / weights);
    }
  return coarse;
}

Plane resampled(const Plane& plane, int width, int height) {
  Plane result(width, height);
  const double scale_x = static_cast<double>(plane.width()) / width,
               scale_y = static_cast<double>(plane.height()) / height;
  const auto overlap = [](double lo, double hi, int pixel) {
    return std::min(hi, pixel + 1.0) - std::max(lo, static_cast<double>(pixel));
  };
  for (int j = 0; j < height; ++j)
    for (int i = 0; i < width; ++i) {
      const double x0 = i * scale_x, x1 = (i + 1) * scale_x, y0 = j * scale_y, y1 = (j + 1) * scale_y;
      double sum = 0, weights = 0;
      for (int y = static_cast<int>(y0); y < std::min<double>(y1, plane.height()); ++y)
        for (int x = static_cast<int>(x0); x < std::min<double>(x1, plane.width()); ++x) {
          const double weight = overlap(x0, x1, x) * overlap(y0, y1, y);
          sum += weight * plane(x, y);
          weights += weight;
        }
      result(i, j) = static_cast<float>(sum / weights);
    }
  return result;
}

}  // namespace brume
