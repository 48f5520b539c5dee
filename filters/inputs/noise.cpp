#include "filters/inputs/noise.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filters/inputs/planes.h"
#include "image/color.h"

namespace brume {
namespace {

// Level of the noise is estimated over 21 x 21 pixels, as Rousselle, Manzi and Zwicker 2013 do.
constexpr int kLevelRadius = 10;

Plane squared_half_difference(const RgbPlanes& a, const RgbPlanes& b, size_t c, const Task& task) {
  return make_plane(a[c]->width(), a[c]->height(), quiet(task), [&](int x, int y) {
    const float d = (*a[c])(x, y) - (*b[c])(x, y);
    return 0.25f * d * d;
  });
}

Plane neighbourhood_variance(const Plane& mean, const Task& task) {
  return make_plane(mean.width(), mean.height(), quiet(task), [&](int x, int y) {
    double sum = 0, squares = 0;
    int n = 0;
    for (int qy = std::max(0, y - 1); qy <= std::min(mean.height() - 1, y + 1); ++qy)
      for (int qx = std::max(0, x - 1); qx <= std::min(mean.width() - 1, x + 1); ++qx) {
        const double d = static_cast<double>(mean(qx, qy)) - mean(x, y);
        sum += d;
        squares += d * d;
        ++n;
      }
    return static_cast<float>(n > 1 ? std::max(0.0, squares - sum * sum / n) / (n - 1) : 0.0);
  });
}

}  // namespace

void lift_variance(Plane& variance, const Plane& mean, const Task& task) {
  const Plane median = median3x3(variance, task);
  for_each_row(mean.height(), quiet(task), [&](int y) {
    float* v = variance.row(y);
    const float *m = median.row(y), *x_row = mean.row(y);
    for (int x = 0; x < mean.width(); ++x) {
      // Capped where squares leave the range of floats, so that later ratios stay numbers.
      const float floor = std::min(1e-8f * x_row[x] * x_row[x] + 1e-12f, 1e30f);
      v[x] = std::min(std::max(std::max(v[x], 0.25f * m[x]), floor), 1e30f);
    }
  });
}

bool has_halves(const Layers& frame, const LayerName& signal) {
  return frame.has(signal, statistic::half_a) && frame.has(signal, statistic::half_b) &&
         frame.number("samplesPerPixel").value_or(2.0) >= 2;
}

Rgb corrected_variance(const RgbPlanes& mean, const RgbPlanes& variance, const RgbPlanes& half_a,
                       const RgbPlanes& half_b, const Plane* samples, const Task& task) {
  Rgb out;
  const int width = mean[0]->width(), height = mean[0]->height();
  Plane ratio;
  if (half_a[0] && half_b[0]) {
    // One level for the three channels: a third of the scatter.
    Plane own(width, height), halves(width, height);
    for (size_t c = 0; c < 3; ++c)
      for_each_pixel(width, height, quiet(task), [&](int x, int y) {
        const float d = (*half_a[c])(x, y) - (*half_b[c])(x, y);
        own.row(y)[x] += std::min((*variance[c])(x, y), 1e30f);
        halves.row(y)[x] += std::min(0.25f * d * d, 1e30f);
      });
    const Plane own_level = box_mean(own, kLevelRadius, task), halves_level = box_mean(halves, kLevelRadius, task);
    ratio = make_plane(width, height, quiet(task), [&](int x, int y) {
      return own_level(x, y) > 1e-30f ? std::min(halves_level(x, y) / own_level(x, y), 4.0f) : 1.0f;
    });
  }
  bool lone = false;  // any pixel with one sample
  for (int y = 0; samples && !lone && y < height; ++y)
    for (const float n : samples->pixels(y)) lone |= n < 1.5f;
  for (size_t c = 0; c < 3; ++c) {
    const Plane spatial = lone ? neighbourhood_variance(*mean[c], task) : Plane();
    out[c] = make_plane(width, height, quiet(task), [&](int x, int y) {
      if (lone && (*samples)(x, y) < 1.5f) return spatial(x, y);
      return (*variance[c])(x, y) * (ratio.empty() ? 1.0f : ratio(x, y));
    });
    lift_variance(out[c], *mean[c], task);
  }
  return out;
}

Rgb variance_of_halves(const RgbPlanes& mean, const RgbPlanes& half_a, const RgbPlanes& half_b, const Task& task) {
  Rgb out;
  for (size_t c = 0; c < 3; ++c) {
    out[c] = box_mean(squared_half_difference(half_a, half_b, c, task), 2, task);
    lift_variance(out[c], *mean[c], task);
  }
  return out;
}

double lab_noise(const RgbPlanes& mean, const RgbPlanes& variance, const RgbPlanes& half_a, const RgbPlanes& half_b,
                 double exposure, const Plane* medium, const FrameSpace& space) {
  constexpr int kBlock = 8, kFewest = 16;
  const int width = mean[0]->width(), height = mean[0]->height();
  const auto squared = [&](int x, int y) {
    dvec3 a, b;
    for (int c = 0; c < 3; ++c) {
      const size_t i = static_cast<size_t>(c);
      if (half_a[0] && half_b[0]) {
        a[c] = (*half_a[i])(x, y);
        b[c] = (*half_b[i])(x, y);
      } else {
        const double m = (*mean[i])(x, y), s = std::sqrt(std::max(0.0f, (*variance[i])(x, y)));
        a[c] = m + s;
        b[c] = m - s;
      }
    }
    const dvec3 d =
        0.5 * (lab_from_rgb(exposure * a, space.xyz_from_rgb()) - lab_from_rgb(exposure * b, space.xyz_from_rgb()));
    return glm::dot(d, d);
  };
  std::vector<double> blocks;
  for (int y0 = 0; y0 < height; y0 += kBlock)
    for (int x0 = 0; x0 < width; x0 += kBlock) {
      double sum = 0;
      int n = 0;
      for (int y = y0; y < std::min(height, y0 + kBlock); ++y)
        for (int x = x0; x < std::min(width, x0 + kBlock); ++x)
          if (!medium || (*medium)(x, y) > 0)
            if (const double d = squared(x, y); std::isfinite(d)) {
              sum += d;
              ++n;
            }
      // Blocks of nothing but background have no noise, and no say.
      if (sum > 0 && n >= std::min(kFewest, width * height)) blocks.push_back(std::sqrt(sum / n));
    }
  if (blocks.empty()) return 0;
  const auto middle = blocks.begin() + static_cast<std::ptrdiff_t>(blocks.size() / 2);
  std::nth_element(blocks.begin(), middle, blocks.end());
  return *middle;
}

double typical_luminance(const RgbPlanes& picture) {
  constexpr double kPixels = 65536;
  const int width = picture[0]->width(), height = picture[0]->height();
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(width) * height / kPixels)));
  std::vector<double> values;
  for (int y = 0; y < height; y += step)
    for (int x = 0; x < width; x += step) {
      const double l = 0.265 * (*picture[0])(x, y) + 0.670 * (*picture[1])(x, y) + 0.065 * (*picture[2])(x, y);
      if (l > 0 && std::isfinite(l)) values.push_back(l);
    }
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Plane limit_outliers(NoisySignal& signal, Outliers how, const FrameSpace& space, const Task& task) {
  const int width = signal.mean[0].width(), height = signal.mean[0].height();
  const auto grey = [&](const Rgb& rgb) {
    return make_plane(width, height, quiet(task),
                      [&](int x, int y) { return space.luminance(vec3(rgb[0](x, y), rgb[1](x, y), rgb[2](x, y))); });
  };
  const Plane light = grey(signal.mean);
  const Plane deviation = make_plane(width, height, quiet(task), [&](int x, int y) {
    const auto s = [&](size_t c) { return std::sqrt(std::max(0.0f, signal.variance[c](x, y))); };
    return space.luminance(vec3(s(0), s(1), s(2)));
  });
  Plane factor(width, height, 1.0f), removed(width, height);
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<float> lights, deviations;
    for (int x = 0; x < width; ++x) {
      lights.clear();
      deviations.clear();
      float brightest_other = 0;
      for (int qy = std::max(0, y - 2); qy <= std::min(height - 1, y + 2); ++qy)
        for (int qx = std::max(0, x - 2); qx <= std::min(width - 1, x + 2); ++qx) {
          lights.push_back(light(qx, qy));
          deviations.push_back(deviation(qx, qy));
          if (qx != x || qy != y) brightest_other = std::max(brightest_other, light(qx, qy));
        }
      const auto median = [](std::vector<float>& v) {
        const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
        std::nth_element(v.begin(), middle, v.end());
        return *middle;
      };
      if (lights.size() < 4) continue;
      const float limit = median(lights) + 6 * median(deviations);
      if (!(light(x, y) > limit) || !(light(x, y) > 0)) continue;
      bool one_sample = light(x, y) > 2 * brightest_other;
      if (!signal.buckets.empty()) {
        float largest = 0, sum = 0;
        for (const Rgb& bucket : signal.buckets) {
          const float v = space.luminance(vec3(bucket[0](x, y), bucket[1](x, y), bucket[2](x, y)));
          largest = std::max(largest, v);
          sum += v;
        }
        one_sample = largest > 0.5f * sum;
      }
      if (!one_sample) continue;
      factor(x, y) = std::max(limit, 0.0f) / light(x, y);
      removed(x, y) = light(x, y) - std::max(limit, 0.0f);
    }
  });
  Rgb lost;
  for (size_t c = 0; c < 3; ++c) {
    lost[c] = make_plane(width, height, quiet(task),
                         [&](int x, int y) { return signal.mean[c](x, y) * (1.0f - factor(x, y)); });
    const auto scale = [&](Plane& p, bool squared) {
      if (p.empty()) return;
      for_each_pixel(width, height, quiet(task),
                     [&](int x, int y) { p.row(y)[x] *= squared ? factor(x, y) * factor(x, y) : factor(x, y); });
    };
    scale(signal.mean[c], false);
    scale(signal.half_a[c], false);
    scale(signal.half_b[c], false);
    scale(signal.variance[c], true);
    for (Rgb& bucket : signal.buckets) scale(bucket[c], false);
    if (how == Outliers::kRedistribute) {
      const Plane spread = gaussian_blur(lost[c], 5, task);
      const auto add = [&](Plane& p) {
        if (p.empty()) return;
        for_each_pixel(width, height, quiet(task), [&](int x, int y) { p.row(y)[x] += spread(x, y); });
      };
      add(signal.mean[c]);
      add(signal.half_a[c]);
      add(signal.half_b[c]);
      for (Rgb& bucket : signal.buckets) add(bucket[c]);
    }
  }
  return removed;
}

}  // namespace brume
