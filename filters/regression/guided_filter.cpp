#include "filters/regression/guided_filter.h"

#include <algorithm>
#include <cstring>
#include <vector>

#include "filters/kernels/regression.h"
#include "filters/kernels/rows.h"
#include "filters/patch/neighbourhood.h"

namespace brume {
namespace {

std::vector<float> inverse_counts(int length, int radius) {
  std::vector<float> inverse;
  for (int i = 0; i < length; ++i)
    inverse.push_back(1.0f / static_cast<float>(std::min(length - 1, i + radius) - std::max(0, i - radius) + 1));
  return inverse;
}

/// The whole of a picture, or of a block, at once: a plane for every product of the guide's channels.
std::vector<Plane> filter_at_once(std::span<const Plane* const> inputs, std::span<const Plane* const> guide, int radius,
                                  float eps, const Task& task) {
  const int width = inputs[0]->width(), height = inputs[0]->height();
  const int d = static_cast<int>(guide.size()), m = static_cast<int>(inputs.size());
  const size_t stride = static_cast<size_t>(width + 15) / 16 * 16;
  const std::vector<float> columns = inverse_counts(width, radius), lines = inverse_counts(height, radius);

  // Sums over rows of: the guide, the inputs, guide x guide, guide x inputs.
  const int products = d + m + d * (d + 1) / 2 + d * m;
  std::vector<Plane> horizontal(static_cast<size_t>(products), Plane(width, height));
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<float> product(stride);
    size_t next = 0;
    const auto add = [&](const float* row) { kernels::box_row(row, horizontal[next++].row(y), width, radius); };
    const auto add_product = [&](const float* a, const float* b) {
      for (int x = 0; x < width; ++x) product[static_cast<size_t>(x)] = a[x] * b[x];
      add(product.data());
    };
    for (const Plane* g : guide) add(g->row(y));
    for (const Plane* p : inputs) add(p->row(y));
    for (size_t i = 0; i < guide.size(); ++i)
      for (size_t j = i; j < guide.size(); ++j) add_product(guide[i]->row(y), guide[j]->row(y));
    for (const Plane* g : guide)
      for (const Plane* p : inputs) add_product(g->row(y), p->row(y));
  });

  // Coefficients of every window, summed along rows again: a (d x m), then b (m).
  std::vector<Plane> coefficients(static_cast<size_t>(d * m + m), Plane(width, height));
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<float> mean(stride * static_cast<size_t>(products));
    const auto mean_row = [&](int i) { return mean.data() + stride * static_cast<size_t>(i); };
    const int top = std::max(0, y - radius), bottom = std::min(height - 1, y + radius);
    std::vector<const float*> rows(static_cast<size_t>(bottom - top + 1));
    for (int i = 0; i < products; ++i) {
      for (int q = top; q <= bottom; ++q)
        rows[static_cast<size_t>(q - top)] = horizontal[static_cast<size_t>(i)].row(q);
      float* to = mean_row(i);
      kernels::sum_rows(rows.data(), static_cast<int>(rows.size()), to, width);
      const float line = lines[static_cast<size_t>(y)];
      for (int x = 0; x < width; ++x) to[x] *= line * columns[static_cast<size_t>(x)];
    }
    const auto covariance = [&](float* product, const float* a, const float* b, float floor) {
      for (int x = 0; x < width; ++x) product[x] -= a[x] * b[x];
      if (floor >= 0)
        for (int x = 0; x < width; ++x) product[x] = std::max(product[x], 0.0f) + floor;
    };
    int next = d + m;
    float* const sigma = mean_row(next);
    for (int i = 0; i < d; ++i)
      for (int j = i; j < d; ++j) covariance(mean_row(next++), mean_row(i), mean_row(j), i == j ? eps : -1.0f);
    float* const a = mean_row(next);
    for (int i = 0; i < d; ++i)
      for (int c = 0; c < m; ++c) covariance(mean_row(next++), mean_row(i), mean_row(d + c), -1.0f);
    kernels::solve_rows(sigma, a, d, m, width, stride, 0, 0);
    std::vector<float> b(stride);
    for (int c = 0; c < m; ++c) {
      const float* p = mean_row(d + c);
      for (int x = 0; x < width; ++x) b[static_cast<size_t>(x)] = p[x];
      for (int i = 0; i < d; ++i) {
        const float *ai = a + stride * static_cast<size_t>(i * m + c), *g = mean_row(i);
        for (int x = 0; x < width; ++x) b[static_cast<size_t>(x)] -= ai[x] * g[x];
        kernels::box_row(ai, coefficients[static_cast<size_t>(i * m + c)].row(y), width, radius);
      }
      kernels::box_row(b.data(), coefficients[static_cast<size_t>(d * m + c)].row(y), width, radius);
    }
  });
  horizontal.clear();

  std::vector<Plane> out(inputs.size(), Plane(width, height));
  for_each_row(height, task, [&](int y) {
    const int top = std::max(0, y - radius), bottom = std::min(height - 1, y + radius);
    std::vector<const float*> rows(static_cast<size_t>(bottom - top + 1));
    std::vector<float> sum(stride);
    const auto summed = [&](int i) {
      for (int q = top; q <= bottom; ++q)
        rows[static_cast<size_t>(q - top)] = coefficients[static_cast<size_t>(i)].row(q);
      kernels::sum_rows(rows.data(), static_cast<int>(rows.size()), sum.data(), width);
    };
    for (int c = 0; c < m; ++c) {
      float* to = out[static_cast<size_t>(c)].row(y);
      summed(d * m + c);
      for (int x = 0; x < width; ++x) to[x] = sum[static_cast<size_t>(x)];
      for (int i = 0; i < d; ++i) {
        summed(i * m + c);
        const float* g = guide[static_cast<size_t>(i)]->row(y);
        for (int x = 0; x < width; ++x) to[x] += sum[static_cast<size_t>(x)] * g[x];
      }
      const float line = lines[static_cast<size_t>(y)];
      for (int x = 0; x < width; ++x) to[x] *= line * columns[static_cast<size_t>(x)];
    }
  });
  return out;
}

}  // namespace

std::vector<Plane> guided_filter(std::span<const Plane* const> inputs, std::span<const Plane* const> guide, int radius,
                                 float eps, const Task& task) {
  // Blocks whose products stay in the cache, each with an apron as wide as both windows reach.
  constexpr int kWidth = 256, kHeight = 64;
  const int width = inputs[0]->width(), height = inputs[0]->height();
  std::vector<Plane> out(inputs.size(), Plane(width, height));
  for_each_block(width, height, kWidth, kHeight, task, [&](const Box& block) {
    const Box outer = block.grown(2 * radius, width, height);
    std::vector<Plane> in, by;
    for (const Plane* p : inputs) in.push_back(crop(*p, outer));
    for (const Plane* g : guide) by.push_back(crop(*g, outer));
    const std::vector<Plane> part = filter_at_once(pointers(in), pointers(by), radius, eps, {1, {}, task.cancel});
    for (size_t c = 0; c < part.size(); ++c)
      for (int y = block.y0; y < block.y1; ++y)
        std::memcpy(out[c].row(y) + block.x0, part[c].row(y - outer.y0) + (block.x0 - outer.x0),
                    sizeof(float) * static_cast<size_t>(block.width()));
  });
  return out;
}

}  // namespace brume
