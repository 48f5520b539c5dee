#include "filters/regression/clamped_halves.h"

#include <algorithm>
#include <cmath>

#include "base/vec.h"
#include "filters/regression/half_pairs.h"
#include "filters/regression/regression.h"

namespace brume {
namespace {

// Windows of local means of noise and of what returns the light taken from outliers [px].
constexpr double kNoiseWindow = 10, kReturnWindow = 32;
// An outlier is this many times what the other half shows, and more.
constexpr float kAgreement = 3;
// What both halves show is a point, a lamp or a star, where within this radius [px] no more pixels than these have a
// quarter of it.
constexpr int kPointRadius = 3, kPointPixels = 4;
constexpr float kPointShare = 0.25f;

}  // namespace

ClampedHalves clamp_outliers(const RgbPlanes& a, const RgbPlanes& b, const Rgb& fit, const Plane& level,
                             const Plane& mask, double limit, bool halves, const Task& task) {
  const int width = level.width(), height = level.height();
  double sum = 0, count = std::max(1e-30, sum_of(mask));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (mask(x, y) > 0) sum += static_cast<double>(std::max(0.0f, level(x, y)));
  const float floor = static_cast<float>(static_cast<double>(kDark) * sum / count) + 1e-30f;
  const auto excess = [&](const RgbPlanes& half) {
    return make_plane(width, height, quiet(task), [&](int x, int y) {
      if (!(mask(x, y) > 0)) return 0.0f;
      const float l = luminance(vec3((*half[0])(x, y), (*half[1])(x, y), (*half[2])(x, y)));
      return (l - level(x, y)) / (std::max(0.0f, level(x, y)) + floor);
    });
  };
  const Plane ua = excess(a), ub = excess(b);
  // The frame's deviation: squares drawn in at `limit` times what the last round found.
  double deviation = 1e15;
  for (int round = 0; round < 30; ++round) {
    double squares = 0;
    const double top = limit * deviation;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (const Plane* u : {&ua, &ub}) {
          const double v = std::min(std::abs(static_cast<double>((*u)(x, y))), top);
          squares += v * v;
        }
    const double next = std::sqrt(squares / (2 * count));
    if (next > 0.999 * deviation) break;
    deviation = next;
  }
  const float top = static_cast<float>(limit * deviation);
  const Plane square = make_plane(width, height, quiet(task), [&](int x, int y) {
    const float va = std::min(std::abs(ua(x, y)), top), vb = std::min(std::abs(ub(x, y)), top);
    return 0.5f * (va * va + vb * vb);
  });
  const Plane one(width, height, 1.0f);
  const Plane local = std::move(local_ratio({&square}, one, mask, kNoiseWindow, task)[0]);
  ClampedHalves out;
  for (size_t c = 0; c < 3; ++c) {
    out.a[c] = *a[c];
    out.b[c] = *b[c];
    out.taken[c] = Plane::lazy_zeros(width, height);
    out.points[c] = Plane::lazy_zeros(width, height);
  }
  const auto is_point = [&](int x, int y) {
    const float agreed = std::min(ua(x, y), ub(x, y));
    int like_it = 0;
    const Box box = Box{x, y, x + 1, y + 1}.grown(kPointRadius, width, height);
    for (int v = box.y0; v < box.y1; ++v)
      for (int u = box.x0; u < box.x1; ++u) like_it += std::min(ua(u, v), ub(u, v)) > kPointShare * agreed;
    return like_it <= kPointPixels;
  };
  for_each_row(height, quiet(task), [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (!(mask(x, y) > 0)) continue;
      const float most = static_cast<float>(limit) * std::sqrt(std::max(0.5f * local(x, y), 0.0f) +
                                                               0.5f * top * top / static_cast<float>(limit * limit));
      // What both halves show is no outlier.
      const bool point = halves && std::min(ua(x, y), ub(x, y)) > most && is_point(x, y);
      const auto draw = [&](const Plane& u, const Plane& other, Rgb& half) {
        const float bound = halves ? std::max(most, kAgreement * other(x, y)) : most;
        if (!(u(x, y) > (point ? most : bound))) return;
        const float share = 1 - std::min(1.0f, bound / u(x, y)), all = point ? 1 - most / u(x, y) : share;
        for (size_t c = 0; c < 3; ++c) {
          const float missed = half[c](x, y) - fit[c](x, y);
          half[c](x, y) -= all * missed;
          out.taken[c](x, y) += 0.5f * share * missed;
          out.points[c](x, y) += 0.5f * (all - share) * missed;
        }
      };
      draw(ua, ub, out.a);
      draw(ub, ua, out.b);
    }
  });
  return out;
}

void redistribute_energy(const Rgb& taken, Rgb& picture, const Plane& mask, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    const Plane base = make_plane(mask.width(), mask.height(), quiet(task),
                                  [&](int x, int y) { return std::max(0.0f, picture[c](x, y)); });
    // With the weight 1 / base the fitted factor is the ratio of the sums.
    const double typical = sum_of(base) / std::max(1.0, sum_of(mask));
    const float least = static_cast<float>(1e-3 * typical) + 1e-30f;
    const Plane weight = make_plane(mask.width(), mask.height(), quiet(task), [&](int x, int y) {
      return mask(x, y) > 0 ? 1.0f / std::max(base(x, y), least) : 0.0f;
    });
    const std::vector<Plane> back = local_ratio({&taken[c]}, base, weight, kReturnWindow, task);
    for_each_row(mask.height(), quiet(task), [&](int y) {
      for (int x = 0; x < mask.width(); ++x) picture[c](x, y) += back[0](x, y);
    });
  }
}

void keep_within_neighbours(const RgbPlanes& data, const Plane& solid, Rgb& picture, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    const Plane low = window_minimum(*data[c], 1, task), high = window_maximum(*data[c], 1, task);
    for_each_row(solid.height(), quiet(task), [&](int y) {
      for (int x = 0; x < solid.width(); ++x)
        if (solid(x, y) > 0) picture[c](x, y) = std::clamp(picture[c](x, y), low(x, y), high(x, y));
    });
  }
}

}  // namespace brume
