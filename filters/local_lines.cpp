#include "filters/local_lines.h"

#include <algorithm>

#include "filters/regression.h"

namespace brume {
namespace {

constexpr int kTile = 64;
// Half widths of a window and of its non-local means' patches [px], and noise deviations still taken as equal.
constexpr int kRadius = 9, kPatch = 3;
constexpr float kStrength = 0.8f;
constexpr double kVarianceWindow = 2;  // over which the halves' difference is averaged [px]

bool any_above_0(const Plane& plane, const Box& box) {
  for (int y = box.y0; y < box.y1; ++y)
    if (std::any_of(plane.row(y) + box.x0, plane.row(y) + box.x1, [](float v) { return v > 0; })) return true;
  return false;
}

Rgb crop(const Rgb& picture, const Box& box) {
  return {brume::crop(picture[0], box), brume::crop(picture[1], box), brume::crop(picture[2], box)};
}

/// Of one half.
Rgb variance_of(const HalfPair& halves, const Task& task) {
  Rgb variance;
  for (size_t c = 0; c < 3; ++c) {
    const Plane &a = halves.a[c], &b = halves.b[c];
    variance[c] = make_plane(a.width(), a.height(), quiet(task), [&](int x, int y) {
      const float d = a(x, y) - b(x, y);
      return 0.5f * d * d + 1e-12f;
    });
    variance[c] = gaussian_blur(variance[c], kVarianceWindow, task);
  }
  return variance;
}

}  // namespace

HalfPair local_lines(const HalfPair& data, const std::vector<const Plane*>& features, const Plane& wanted,
                     const Task& task) {
  const int width = wanted.width(), height = wanted.height();
  HalfPair out = data;
  for (int y = 0; y < height; y += kTile)
    for (int x = 0; x < width; x += kTile) {
      const Box tile{x, y, std::min(width, x + kTile), std::min(height, y + kTile)};
      if (!any_above_0(wanted, tile)) continue;
      const Box outer = tile.grown(2 * kRadius + kPatch, width, height);
      const HalfPair halves{crop(data.a, outer), crop(data.b, outer)};
      const Rgb variance = variance_of(halves, task);
      std::vector<Plane> own;
      for (const Plane* f : features) own.push_back(brume::crop(*f, outer));
      const auto fit = [&](const Rgb& values, const Rgb& other, Rgb& to) {
        RegressionFrame frame;
        const Noisy noisy{view(other), view(variance)};
        frame.model.distances.push_back(noise_distance(noisy, noisy, kPatch, kStrength));
        frame.features = pointers(own);
        frame.values = {&values[0], &values[1], &values[2]};
        const std::vector<Plane> found = collaborative_regression({&frame, 1}, kRadius, quiet(task));
        for (size_t c = 0; c < 3; ++c)
          for (int v = tile.y0; v < tile.y1; ++v)
            std::copy_n(found[c].row(v - outer.y0) + (tile.x0 - outer.x0), tile.width(), to[c].row(v) + tile.x0);
      };
      fit(halves.a, halves.b, out.a);
      fit(halves.b, halves.a, out.b);
    }
  return out;
}

}  // namespace brume
