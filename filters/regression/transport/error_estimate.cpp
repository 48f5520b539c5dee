#include "filters/regression/transport/error_estimate.h"

#include <algorithm>
#include <cmath>

#include "filters/inputs/half_pair.h"
#include "filters/regression/transport/lattice_regression.h"

namespace brume {
namespace {

// Windows of local means of error and bias, and of what single pixels miss [px].
constexpr double kErrorWindow = 6, kBiasWindow = 24, kMissedWindow = 1;
// Squared error over what the halves' difference and what both miss show of it, measured on scenes where the truth is
// known (docs/transport_regression.md).
constexpr float kNoiseShare = 1.6f, kBiasShare = 1.5f;

/// What both halves miss of their own data in a region, each averaged over a few pixels, multiplied: a square of the
/// bias, as the halves' noise is independent. Mean over colours.
Plane missed_by_both(const HalfPair& result, const HalfPair& data, const Plane& region, const Task& task) {
  const int width = region.width(), height = region.height();
  const Plane around = gaussian_blur(region, kMissedWindow, task);
  const auto missed = [&](const Plane& half, const Plane& of) {
    return gaussian_blur(
        make_plane(width, height, quiet(task), [&](int x, int y) { return region(x, y) * (half(x, y) - of(x, y)); }),
        kMissedWindow, task);
  };
  Plane product(width, height);
  for (size_t c = 0; c < 3; ++c) {
    const Plane a = missed(data.a[c], result.a[c]), b = missed(data.b[c], result.b[c]);
    for_each_pixel(width, height, quiet(task), [&](int x, int y) {
      if (region(x, y) > 0) product(x, y) += a(x, y) * b(x, y) / (3 * around(x, y) * around(x, y));
    });
  }
  return product;
}

}  // namespace

Plane squared_error(const HalfPair& result, const HalfPair& data, const std::vector<MixingRegion>& regions,
                    const Task& task) {
  const int width = result.a[0].width(), height = result.a[0].height();
  const Plane noise = make_plane(width, height, quiet(task), [&](int x, int y) {
    float sum = 0;
    for (size_t c = 0; c < 3; ++c) {
      const float d = result.a[c](x, y) - result.b[c](x, y);
      sum += d * d / 12;
    }
    return sum;
  });
  const Plane one(width, height, 1.0f);
  Plane sum(width, height);
  for (const MixingRegion& region : regions) {
    const Plane bias = missed_by_both(result, data, region.share, task);
    const Plane square = make_plane(width, height, quiet(task), [&](int x, int y) { return bias(x, y) * bias(x, y); });
    const auto local = [&](const std::vector<const Plane*>& planes, double window) {
      return local_ratio(planes, one, region.share, window, task);
    };
    const Plane n = std::move(local({&noise}, kErrorWindow)[0]);
    const std::vector<Plane> moments = local({&bias, &square}, kBiasWindow);
    const Plane &m = moments[0], &m2 = moments[1];
    // Neighbours that are averaged together count as one.
    const auto independent = static_cast<float>(kBiasWindow * kBiasWindow / (kMissedWindow * kMissedWindow));
    for_each_pixel(width, height, quiet(task), [&](int x, int y) {
      const float error = std::sqrt(std::max(0.0f, m2(x, y) - m(x, y) * m(x, y)) / independent);
      sum(x, y) +=
          region.share(x, y) * (kNoiseShare * std::max(0.0f, n(x, y)) + kBiasShare * std::max(0.0f, m(x, y) - error));
    });
  }
  return sum;
}

}  // namespace brume
