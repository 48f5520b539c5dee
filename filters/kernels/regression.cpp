#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/regression.cpp"
#include "filters/kernels/regression.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>

// Plain loops over x, compiled for every instruction set: see kernels/rows.h.
HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

void SolveRows(float* a, float* b, int n, int m, int count, size_t stride, float ridge, float floor) {
  const auto entry = [&](int i, int j) { return a + stride * static_cast<size_t>(triangle(i, j, n)); };
  const auto rhs = [&](int i, int c) { return b + stride * static_cast<size_t>(i * m + c); };
  for (int i = n - 1; i >= 0; --i) {
    float* HWY_RESTRICT d = entry(i, i);
    const float* first = entry(0, 0);
    if (i > 0)
      for (int x = 0; x < count; ++x) d[x] += ridge * d[x] + floor * first[x] + 1e-30f;
    else
      for (int x = 0; x < count; ++x) d[x] += ridge * d[x] + 1e-30f;
  }
  // A = U^T D U, the rows of D U in the upper triangle; B is carried along.
  for (int i = 0; i < n; ++i) {
    const float* HWY_RESTRICT d = entry(i, i);
    for (int j = i + 1; j < n; ++j) {
      const float* HWY_RESTRICT u = entry(i, j);
      for (int k = j; k < n; ++k) {
        const float* v = entry(i, k);
        float* HWY_RESTRICT to = entry(j, k);
        for (int x = 0; x < count; ++x) to[x] -= u[x] / d[x] * v[x];
      }
      for (int c = 0; c < m; ++c) {
        const float* HWY_RESTRICT v = rhs(i, c);
        float* HWY_RESTRICT to = rhs(j, c);
        for (int x = 0; x < count; ++x) to[x] -= u[x] / d[x] * v[x];
      }
    }
    // Rounding may leave less than nothing of a column that the others explain.
    if (i + 1 < n) {
      float* HWY_RESTRICT next = entry(i + 1, i + 1);
      for (int x = 0; x < count; ++x) next[x] = next[x] > 1e-30f ? next[x] : 1e30f;
    }
  }
  for (int i = n - 1; i >= 0; --i) {
    const float* HWY_RESTRICT d = entry(i, i);
    for (int c = 0; c < m; ++c) {
      float* HWY_RESTRICT to = rhs(i, c);
      for (int k = i + 1; k < n; ++k) {
        const float* HWY_RESTRICT u = entry(i, k);
        const float* HWY_RESTRICT s = rhs(k, c);
        for (int x = 0; x < count; ++x) to[x] -= u[x] * s[x];
      }
      for (int x = 0; x < count; ++x) to[x] /= d[x];
    }
  }
}

// Neighbours taken at once, so that each sum is loaded and stored once for all of them.
constexpr int kGroup = 4;

void AccumulateNormal(const RegressionRow& row, const float* weights, size_t weight_step, int dx0, int dy, int offsets,
                      float* scratch, float* a, float* b) {
  const size_t features = row.features.size(), values = row.values.size(), stride = row.stride;
  const int n = static_cast<int>(features) + 3, m = static_cast<int>(values), count = row.count;
  const float inverse = 1.0f / static_cast<float>(std::max(row.radius, 1));
  // Regressors (after the constant 1), times the weight, and values of each neighbour: rows of scratch.
  const auto x_row = [&](int k, int j) { return scratch + stride * static_cast<size_t>(k * kGroup + j); };
  const auto wx_row = [&](int k, int j) { return scratch + stride * static_cast<size_t>((n + k) * kGroup + j); };
  const auto y_row = [&](int c, int j) { return scratch + stride * static_cast<size_t>((2 * n + c) * kGroup + j); };
  for (int o = 0; o < offsets; o += kGroup) {
    const int group = std::min(kGroup, offsets - o);
    for (int j = 0; j < kGroup; ++j) {
      const int dx = dx0 + o + std::min(j, group - 1);
      const float* w = weights + weight_step * static_cast<size_t>(o + std::min(j, group - 1));
      const float px = static_cast<float>(dx) * inverse, py = static_cast<float>(dy) * inverse;
      float *one = x_row(0, j), *w0 = wx_row(0, j), *xx = x_row(1, j), *wx = wx_row(1, j), *xy = x_row(2, j),
            *wy = wx_row(2, j);
      for (int x = 0; x < count; ++x) {
        // A group that is not full repeats its last neighbour with weight 0.
        const float v = j < group ? w[x] : 0.0f;
        one[x] = 1.0f;
        w0[x] = v;
        xx[x] = px;
        wx[x] = v * px;
        xy[x] = py;
        wy[x] = v * py;
      }
      for (size_t k = 0; k < features; ++k) {
        const float *p = row.features[k]->row(row.y) + row.x0,
                    *q = row.features_there[k]->row(row.y + dy) + row.x0 + dx;
        float* HWY_RESTRICT to = x_row(static_cast<int>(k) + 3, j);
        float* HWY_RESTRICT weighted = wx_row(static_cast<int>(k) + 3, j);
        const float* HWY_RESTRICT v = w0;
        for (int x = 0; x < count; ++x) {
          to[x] = q[x] - p[x];
          weighted[x] = v[x] * to[x];
        }
      }
      for (size_t c = 0; c < values; ++c) {
        const float *p = row.values[c]->row(row.y) + row.x0, *q = row.values_there[c]->row(row.y + dy) + row.x0 + dx;
        float* HWY_RESTRICT to = y_row(static_cast<int>(c), j);
        for (int x = 0; x < count; ++x) to[x] = q[x] - p[x];
      }
    }
    for (int i = 0; i < n; ++i) {
      const float *w0 = wx_row(i, 0), *w1 = wx_row(i, 1), *w2 = wx_row(i, 2), *w3 = wx_row(i, 3);
      const auto add = [&](const float* v0, const float* v1, const float* v2, const float* v3, float* HWY_RESTRICT to) {
        for (int x = 0; x < count; ++x) to[x] += (w0[x] * v0[x] + w1[x] * v1[x]) + (w2[x] * v2[x] + w3[x] * v3[x]);
      };
      for (int k = i; k < n; ++k)
        add(x_row(k, 0), x_row(k, 1), x_row(k, 2), x_row(k, 3), a + stride * static_cast<size_t>(triangle(i, k, n)));
      for (int c = 0; c < m; ++c)
        add(y_row(c, 0), y_row(c, 1), y_row(c, 2), y_row(c, 3), b + stride * static_cast<size_t>(i * m + c));
    }
  }
}

void ScatterPrediction(const RegressionRow& row, const float* weights, int dx, int dy, const float* b,
                       std::span<const Plane> lowest, std::span<const Plane> highest, std::span<Plane* const> sums,
                       Plane& total) {
  const size_t features = row.features.size(), m = row.values.size(), stride = row.stride;
  const int count = row.count;
  const float inverse = 1.0f / static_cast<float>(std::max(row.radius, 1));
  const float px = static_cast<float>(dx) * inverse, py = static_cast<float>(dy) * inverse;
  constexpr int kChunk = 64;
  for (int first = 0; first < count; first += kChunk) {
    const int n = std::min(kChunk, count - first);
    const size_t at = static_cast<size_t>(first);
    const float* HWY_RESTRICT w = weights + at;
    for (size_t c = 0; c < m; ++c) {
      float prediction[kChunk];
      const float *centre = row.values[c]->row(row.y) + row.x0 + first, *b0 = b + stride * c + at,
                  *b1 = b + stride * (m + c) + at, *b2 = b + stride * (2 * m + c) + at;
      for (int x = 0; x < n; ++x) prediction[x] = centre[x] + b0[x] + px * b1[x] + py * b2[x];
      for (size_t k = 0; k < features; ++k) {
        const float *p = row.features[k]->row(row.y) + row.x0 + first,
                    *q = row.features[k]->row(row.y + dy) + row.x0 + dx + first,
                    *bk = b + stride * ((k + 3) * m + c) + at;
        for (int x = 0; x < n; ++x) prediction[x] += bk[x] * (q[x] - p[x]);
      }
      const float *lo = lowest[c].row(row.y) + row.x0 + first, *hi = highest[c].row(row.y) + row.x0 + first;
      float* HWY_RESTRICT sum = sums[c]->row(row.y + dy) + row.x0 + dx + first;
      for (int x = 0; x < n; ++x) {
        const float p = prediction[x] > lo[x] ? prediction[x] : lo[x];
        sum[x] += w[x] * (p < hi[x] ? p : hi[x]);
      }
    }
    float* HWY_RESTRICT t = total.row(row.y + dy) + row.x0 + dx + first;
    for (int x = 0; x < n; ++x) t[x] += w[x];
  }
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(SolveRows);
HWY_EXPORT(AccumulateNormal);
HWY_EXPORT(ScatterPrediction);

void solve_rows(float* a, float* b, int n, int m, int count, size_t stride, float ridge, float floor) {
  HWY_DYNAMIC_DISPATCH(SolveRows)(a, b, n, m, count, stride, ridge, floor);
}

void accumulate_normal(const RegressionRow& row, const float* weights, size_t weight_step, int dx0, int dy, int offsets,
                       float* scratch, float* a, float* b) {
  HWY_DYNAMIC_DISPATCH(AccumulateNormal)(row, weights, weight_step, dx0, dy, offsets, scratch, a, b);
}

size_t normal_scratch(size_t features, size_t values, size_t stride) {
  return stride * 4 * (2 * (features + 3) + values);
}

void scatter_prediction(const RegressionRow& row, const float* weights, int dx, int dy, const float* b,
                        std::span<const Plane> lowest, std::span<const Plane> highest, std::span<Plane* const> sums,
                        Plane& total) {
  HWY_DYNAMIC_DISPATCH(ScatterPrediction)(row, weights, dx, dy, b, lowest, highest, sums, total);
}

}  // namespace brume::kernels
#endif
