#include "filters/patch/selection.h"

#include <cmath>

#include "base/rng.h"
#include "filters/patch/neighbourhood.h"

namespace brume {

std::vector<Plane> winners(const std::vector<Plane>& errors, const Task& task) {
  std::vector<Plane> maps(errors.size(), Plane(errors[0].width(), errors[0].height()));
  for_each_row(errors[0].height(), quiet(task), [&](int y) {
    for (int x = 0; x < errors[0].width(); ++x) {
      size_t best = 0;
      for (size_t i = 1; i < errors.size(); ++i)
        if (errors[i](x, y) < errors[best](x, y)) best = i;
      maps[best](x, y) = 1.0f;
    }
  });
  return maps;
}

Nudged nudged(const RgbPlanes& noisy, const RgbPlanes& variance, ivec2 origin, const Task& task) {
  constexpr float kStep = 0.05f;
  const int width = noisy[0]->width(), height = noisy[0]->height();
  Nudged out;
  for (size_t c = 0; c < 3; ++c) {
    out.step[c] = make_plane(width, height, quiet(task), [&](int x, int y) {
      // Each channel by itself, so that one channel's change is not taken for another's.
      const uint64_t bits = hash_combine(
          hash_combine(mix64(static_cast<uint64_t>(x + origin.x)), static_cast<uint64_t>(y + origin.y)), c);
      const float sign = bits & 1 ? -1.0f : 1.0f;
      return sign * kStep * std::sqrt((*variance[c])(x, y));
    });
    out.picture[c] =
        make_plane(width, height, quiet(task), [&](int x, int y) { return (*noisy[c])(x, y) + out.step[c](x, y); });
  }
  return out;
}

HalfPair select_by_halves(const std::vector<HalfPair>& candidates, const RgbPlanes& half_a, const RgbPlanes& half_b,
                          const RgbPlanes& variance, const ErrorSmoothing& smoothing, const RgbPlanes& guide,
                          const Task& task) {
  const int width = guide[0]->width(), height = guide[0]->height();
  WeightModel model;
  model.distances.push_back(noise_distance(guide, variance, smoothing.patch_radius, smoothing.strength));
  const std::vector<Offset> window = square_window(smoothing.search_radius);
  std::vector<Plane> errors;
  for (const HalfPair& candidate : candidates)
    errors.push_back(make_plane(width, height, quiet(task), [&](int x, int y) {
      float sum = 0;
      for (size_t c = 0; c < 3; ++c) {
        const float a = (*half_a[c])(x, y), b = (*half_b[c])(x, y), fa = candidate.a[c](x, y),
                    fb = candidate.b[c](x, y);
        const float v = 2 * (*variance[c])(x, y);
        sum += 0.5f * ((b - fa) * (b - fa) - v + (a - fb) * (a - fb) - v) - 0.25f * (fb - fa) * (fb - fa);
      }
      return sum / 3;
    }));
  errors = weighted_average(model, window, pointers(errors), task).values;
  const std::vector<Plane> won = winners(errors, task),
                           maps = weighted_average(model, window, pointers(won), task).values;
  return blend(candidates, maps, task);
}

}  // namespace brume
