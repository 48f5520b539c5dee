#include "filters/regression/transport/local_lines.h"

#include "filters/regression/regression.h"

namespace brume {
namespace {

// Half widths of a window and of its non-local means' patches [px], and noise deviations still taken as equal.
constexpr int kRadius = 6, kPatch = 3;
constexpr float kStrength = 0.8f;
constexpr double kVarianceWindow = 2;  // over which the halves' difference is averaged [px]

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
  const Rgb variance = variance_of(data, task);
  const auto fit = [&](const Rgb& values, const Rgb& other) {
    RegressionFrame frame;
    const Noisy noisy{view(other), view(variance)};
    frame.model.distances.push_back(noise_distance(noisy, noisy, kPatch, kStrength));
    frame.features = features;
    frame.values = {&values[0], &values[1], &values[2]};
    std::vector<Plane> lines = collaborative_regression({&frame, 1}, kRadius, quiet(task), &wanted);
    for (size_t c = 0; c < 3; ++c)
      for_each_pixel(wanted.width(), wanted.height(), quiet(task), [&](int x, int y) {
        if (!(wanted(x, y) > 0)) lines[c](x, y) = values[c](x, y);
      });
    return Rgb{std::move(lines[0]), std::move(lines[1]), std::move(lines[2])};
  };
  return {fit(data.a, data.b), fit(data.b, data.a)};
}

}  // namespace brume
