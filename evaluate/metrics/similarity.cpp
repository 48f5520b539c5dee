#include "evaluate/metrics/similarity.h"

#include <algorithm>
#include <cmath>

#include "base/parallel_for.h"
#include "evaluate/metrics/encoded.h"

namespace brume {
namespace {

constexpr int kRadius = 5;
constexpr double kSigma = 1.5, kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;

std::array<float, 2 * kRadius + 1> window() {
  std::array<double, 2 * kRadius + 1> g{};
  double sum = 0;
  for (int i = -kRadius; i <= kRadius; ++i)
    sum += g[static_cast<size_t>(i + kRadius)] = std::exp(-i * i / (2 * kSigma * kSigma));
  std::array<float, 2 * kRadius + 1> weights{};
  for (size_t i = 0; i < g.size(); ++i) weights[i] = static_cast<float>(g[i] / sum);
  return weights;
}

/// The pixel that stands for one beyond the border.
int mirrored(int i, int size) {
  const int period = 2 * size;
  i = ((i % period) + period) % period;
  return i < size ? i : period - 1 - i;
}

Plane luma(const RgbPlanes& rgb, double exposure, const Task& task) {
  Plane plane(rgb[0]->width(), rgb[0]->height());
  parallel_for(plane.height(), task, [&](int y) {
    for (int x = 0; x < plane.width(); ++x) {
      const auto encoded = [&](size_t c) { return srgb_code((*rgb[c])(x, y), exposure); };
      plane(x, y) = 0.299f * encoded(0) + 0.587f * encoded(1) + 0.114f * encoded(2);
    }
  });
  return plane;
}

}  // namespace

Plane ssim_map(const RgbPlanes& test, const RgbPlanes& reference, double exposure, const Task& task) {
  const Task silent = quiet(task);
  const Plane a = luma(test, exposure, silent), b = luma(reference, exposure, silent);
  const int width = a.width(), height = a.height();
  const auto weights = window();
  Plane map(width, height);
  constexpr int kBand = 32;
  const auto n = static_cast<size_t>(width);
  parallel_for((height + kBand - 1) / kBand, silent, [&](int band) {
    const int y0 = band * kBand, rows = std::min(kBand, height - y0);
    // Means of a, b, a^2, b^2 and a b along the rows, then down the columns.
    std::array<std::vector<float>, 5> across, sums;
    for (auto& list : across) list.assign(n * static_cast<size_t>(rows + 2 * kRadius), 0);
    std::array<std::vector<float>, 5> padded;
    for (auto& list : padded) list.resize(n + 2 * kRadius);
    for (int i = 0; i < rows + 2 * kRadius; ++i) {
      const int y = mirrored(y0 + i - kRadius, height);
      for (int x = -kRadius; x < width + kRadius; ++x) {
        const int from = mirrored(x, width);
        const float va = a(from, y), vb = b(from, y);
        const auto at = static_cast<size_t>(x + kRadius);
        padded[0][at] = va;
        padded[1][at] = vb;
        padded[2][at] = va * va;
        padded[3][at] = vb * vb;
        padded[4][at] = va * vb;
      }
      for (size_t m = 0; m < 5; ++m) {
        float* out = &across[m][n * static_cast<size_t>(i)];
        for (size_t k = 0; k < weights.size(); ++k) {
          const float* in = &padded[m][k];
          for (size_t x = 0; x < n; ++x) out[x] += weights[k] * in[x];
        }
      }
    }
    for (int row = 0; row < rows; ++row) {
      for (size_t m = 0; m < 5; ++m) {
        sums[m].assign(n, 0);
        for (size_t k = 0; k < weights.size(); ++k) {
          const float* in = &across[m][n * (static_cast<size_t>(row) + k)];
          for (size_t x = 0; x < n; ++x) sums[m][x] += weights[k] * in[x];
        }
      }
      float* out = map.row(y0 + row);
      for (size_t x = 0; x < n; ++x) {
        const double ma = sums[0][x], mb = sums[1][x];
        const double va = sums[2][x] - ma * ma, vb = sums[3][x] - mb * mb, covariance = sums[4][x] - ma * mb;
        out[x] = static_cast<float>((2 * ma * mb + kC1) * (2 * covariance + kC2) /
                                    ((ma * ma + mb * mb + kC1) * (va + vb + kC2)));
      }
    }
  });
  return map;
}

}  // namespace brume
