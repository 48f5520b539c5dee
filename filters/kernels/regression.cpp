#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/regression.cpp"
#include "filters/kernels/regression.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <type_traits>

// Every pixel has a lane of its own, so that its sums have one order whatever the width of a vector: see
// kernels/rows.h.
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

/// to -= l * v
HWY_INLINE void subtract(const double* HWY_RESTRICT l, const double* HWY_RESTRICT v, double* HWY_RESTRICT to) {
  for (size_t x = 0; x < kTogether; ++x) to[x] -= l[x] * v[x];
}
HWY_INLINE void scale(const double* HWY_RESTRICT factor, double* HWY_RESTRICT to) {
  for (size_t x = 0; x < kTogether; ++x) to[x] *= factor[x];
}

void SolveTogether(double* a, double* b, double* HWY_RESTRICT variance, size_t n, size_t m, size_t free,
                   const double* HWY_RESTRICT ridge, double dependent) {
  const auto entry = [&](size_t i, size_t j) { return a + kTogether * (i * (2 * n - i + 1) / 2 + j - i); };
  const auto rhs = [&](size_t i, size_t t) { return b + kTogether * (i * m + t); };
  for (size_t i = 0; i < n; ++i) std::copy_n(entry(i, i), kTogether, variance + kTogether * i);
  for (size_t i = 0; i < n; ++i) {
    const auto left = [&](size_t k, size_t x) {
      const double d = entry(k, k)[x];
      return d > dependent * variance[kTogether * k + x] ? d : 0.0;
    };
    // What is left of the diagonal now is the other columns' variance given the free ones.
    for (size_t k = i; i == free && k < n; ++k)
      for (size_t x = 0; x < kTogether; ++x) entry(k, k)[x] = (1 + ridge[x]) * left(k, x);
    double inverse[kTogether];
    for (size_t x = 0; x < kTogether; ++x) inverse[x] = left(i, x) > 0 ? 1 / left(i, x) : 0.0;
    for (size_t j = i + 1; j < n; ++j) {
      double l[kTogether];
      bool any = false;
      for (size_t x = 0; x < kTogether; ++x) {
        l[x] = entry(i, j)[x] * inverse[x];
        any |= l[x] != 0;
      }
      if (!any) continue;
      for (size_t k = j; k < n; ++k) subtract(l, entry(i, k), entry(j, k));
      for (size_t t = 0; t < m; ++t) subtract(l, rhs(i, t), rhs(j, t));
    }
    for (size_t j = i + 1; j < n; ++j) scale(inverse, entry(i, j));
    for (size_t t = 0; t < m; ++t) scale(inverse, rhs(i, t));
  }
  for (size_t i = n; i-- > 0;)
    for (size_t j = i + 1; j < n; ++j)
      for (size_t t = 0; t < m; ++t) subtract(entry(i, j), rhs(j, t), rhs(i, t));
}

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kRegressionLanes>;
using V = hn::Vec<D>;

// One vector of pixels and the neighbours of theirs in one row that have weights: weights times features, features,
// values, each a list with one vector for each neighbour.
struct NeighbourProducts {
  float* data;
  size_t list;  // floats
  int features, values, neighbours;
  float* weighted(int k) const { return data + list * static_cast<size_t>(k); }
  float* column(int k) const { return data + list * static_cast<size_t>(features + k); }  // features, then values
};

// Sums of rows i .. i + R - 1 of the normal equations and columns k .. k + C - 1, held in registers for all neighbours.
template <int R, int C>
HWY_INLINE void add_tile(const NeighbourProducts& p, int i, int k, float* const (&to)[R][C]) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  V sum[R][C];
  for (int r = 0; r < R; ++r)
    for (int c = 0; c < C; ++c) sum[r][c] = hn::Zero(d);
  const float *w = p.weighted(i), *x = p.column(k);
  for (int j = 0; j < p.neighbours; ++j, w += lanes, x += lanes) {
    V left[R];
    for (int r = 0; r < R; ++r) left[r] = hn::Load(d, w + p.list * static_cast<size_t>(r));
    for (int c = 0; c < C; ++c) {
      const V right = hn::Load(d, x + p.list * static_cast<size_t>(c));
      for (int r = 0; r < R; ++r) sum[r][c] = hn::MulAdd(left[r], right, sum[r][c]);
    }
  }
  for (int r = 0; r < R; ++r)
    for (int c = 0; c < C; ++c)
      if (to[r][c]) hn::Store(hn::Load(d, to[r][c]) + sum[r][c], d, to[r][c]);
}

template <int R, class To>
void add_columns(const NeighbourProducts& p, int i, int k, int columns, const To& to) {
  const auto tile = [&]<int C>(std::integral_constant<int, C>) HWY_ATTR {
    float* targets[R][C];
    for (int r = 0; r < R; ++r)
      for (int c = 0; c < C; ++c) targets[r][c] = to(i + r, k + c);
    add_tile<R, C>(p, i, k, targets);
  };
  switch (columns) {
    case 1:
      return tile(std::integral_constant<int, 1>());
    case 2:
      return tile(std::integral_constant<int, 2>());
    case 3:
      return tile(std::integral_constant<int, 3>());
    case 4:
      return tile(std::integral_constant<int, 4>());
    case 5:
      return tile(std::integral_constant<int, 5>());
    default:
      return tile(std::integral_constant<int, 6>());
  }
}

void AccumulateNormal(const RegressionRow& row, const float* weights, size_t weight_step, int dy, float* scratch,
                      float* a, float* b) {
  const D d;
  const size_t lanes = hn::Lanes(d), stride = row.stride;
  const int features = row.features, m = row.values, n = features + 3, side = 2 * row.radius + 1;
  const float inverse = 1.0f / static_cast<float>(std::max(row.radius, 1));
  const V py = hn::Set(d, static_cast<float>(dy) * inverse);
  // A row of weights, one of their products with dx, then the lists.
  const size_t list = lanes * static_cast<size_t>(side);
  NeighbourProducts p{scratch + 2 * list, list, features, m, 0};
  for (size_t x = 0; x < static_cast<size_t>(row.count); x += lanes) {
    int columns[kRegressionSide];
    p.neighbours = 0;
    V w0 = hn::Zero(d), w1 = hn::Zero(d), w2 = hn::Zero(d);
    for (int j = 0; j < side; ++j) {
      const V w = hn::Load(d, weights + weight_step * static_cast<size_t>(j) + x);
      if (hn::AllTrue(d, hn::Eq(w, hn::Zero(d)))) continue;
      const V px = hn::Set(d, static_cast<float>(j - row.radius) * inverse), wx = w * px;
      const size_t at = lanes * static_cast<size_t>(p.neighbours);
      hn::Store(w, d, scratch + at);
      hn::Store(wx, d, scratch + list + at);
      w0 += w;
      w1 += wx;
      w2 = hn::MulAdd(wx, px, w2);
      columns[p.neighbours++] = j;
    }
    if (p.neighbours == 0) continue;
    const auto add = [&](float* to, V v) HWY_ATTR { hn::Store(hn::Load(d, to) + v, d, to); };
    const auto entry = [&](int i, int k) { return a + stride * static_cast<size_t>(triangle(i, k, n)) + x; };
    const auto rhs = [&](int i, int c) { return b + stride * static_cast<size_t>(i * m + c) + x; };
    // dy is the same in the whole row.
    const auto add_position = [&](float* of_1, float* of_x, float* of_y, V s0, V s1) HWY_ATTR {
      add(of_1, s0);
      add(of_x, s1);
      add(of_y, py * s0);
    };
    add_position(entry(0, 0), entry(0, 1), entry(0, 2), w0, w1);
    add(entry(1, 1), w2);
    add(entry(1, 2), py * w1);
    add(entry(2, 2), py * py * w0);
    for (int k = 0; k < features + m; ++k) {
      const V centre = hn::LoadU(d, row.here + row.plane * static_cast<size_t>(k) + x);
      const float* there = row.there + row.plane * static_cast<size_t>(k) + x;
      float *to = p.column(k), *weighted = p.weighted(std::min(k, features - 1));
      const float *w = scratch, *wx = scratch + list;
      V s0 = hn::Zero(d), s1 = hn::Zero(d);
      for (int j = 0; j < p.neighbours; ++j, to += lanes, weighted += lanes, w += lanes, wx += lanes) {
        const V v = hn::LoadU(d, there + columns[j]) - centre;
        hn::Store(v, d, to);
        if (k < features) {
          const V product = hn::Load(d, w) * v;
          hn::Store(product, d, weighted);
          s0 += product;
        } else {
          s0 = hn::MulAdd(hn::Load(d, w), v, s0);
        }
        s1 = hn::MulAdd(hn::Load(d, wx), v, s1);
      }
      if (k < features)
        add_position(entry(0, k + 3), entry(1, k + 3), entry(2, k + 3), s0, s1);
      else
        add_position(rhs(0, k - features), rhs(1, k - features), rhs(2, k - features), s0, s1);
    }
    const auto target = [&](int i, int k) -> float* {
      return k >= features ? rhs(i + 3, k - features) : k >= i ? entry(i + 3, k + 3) : nullptr;
    };
    constexpr int kColumns = 6;
    for (int i = 0; i < features; i += 2) {
      const int total = features + m - i, tiles = (total + kColumns - 1) / kColumns;
      for (int t = 0; t < tiles; ++t) {
        const int first = i + total * t / tiles, last = i + total * (t + 1) / tiles;
        if (i + 1 < features)
          add_columns<2>(p, i, first, last - first, target);
        else
          add_columns<1>(p, i, first, last - first, target);
      }
    }
  }
}

// Predictions of `count` vectors of pixels for their neighbours in R rows, and M values from c on.
template <int R, int M>
void scatter_rows(const ScatterRow& s, int dx, int dy, int c, bool weights_too) {
  const RegressionRow& row = s.row;
  const D d;
  const size_t lanes = hn::Lanes(d), stride = row.stride, values = static_cast<size_t>(row.values);
  const float inverse = 1.0f / static_cast<float>(std::max(row.radius, 1));
  const V px = hn::Set(d, static_cast<float>(dx) * inverse);
  const size_t features = static_cast<size_t>(row.features), first = static_cast<size_t>(c);
  const float* const q = row.there + (dx + row.radius);
  float* const sums = s.sums + (dx + row.radius);
  for (size_t x = 0; x < static_cast<size_t>(row.count); x += lanes) {
    V w[R];
    bool any = false;
    for (int r = 0; r < R; ++r) {
      w[r] = hn::Load(d, s.weights + s.weight_row * static_cast<size_t>(r) + x);
      any = any || !hn::AllTrue(d, hn::Eq(w[r], hn::Zero(d)));
    }
    if (!any) continue;
    V prediction[R][M];
    for (size_t v = 0; v < M; ++v) {
      const float* of = s.b + stride * (first + v) + x;
      const V centre = hn::LoadU(d, row.here + row.plane * (features + first + v) + x);
      const V level = hn::MulAdd(px, hn::Load(d, of + stride * values), centre + hn::Load(d, of));
      const V slope = hn::Load(d, of + 2 * stride * values);
      for (int r = 0; r < R; ++r)
        prediction[r][v] = hn::MulAdd(hn::Set(d, static_cast<float>(dy + r) * inverse), slope, level);
    }
    for (size_t k = 0; k < features; ++k) {
      const V centre = hn::LoadU(d, row.here + row.plane * k + x);
      V step[R];
      for (int r = 0; r < R; ++r)
        step[r] = hn::LoadU(d, q + row.plane * k + row.pitch * static_cast<size_t>(r) + x) - centre;
      for (size_t v = 0; v < M; ++v) {
        const V slope = hn::Load(d, s.b + stride * ((k + 3) * values + first + v) + x);
        for (int r = 0; r < R; ++r) prediction[r][v] = hn::MulAdd(slope, step[r], prediction[r][v]);
      }
    }
    for (size_t v = 0; v < M; ++v) {
      const V low = hn::LoadU(d, s.lowest[first + v] + x), high = hn::LoadU(d, s.highest[first + v] + x);
      for (int r = 0; r < R; ++r) {
        float* to = sums + row.plane * (first + v) + row.pitch * static_cast<size_t>(r) + x;
        const V bounded = hn::Min(hn::Max(prediction[r][v], low), high);
        hn::StoreU(hn::MulAdd(w[r], bounded, hn::LoadU(d, to)), d, to);
      }
    }
    if (!weights_too) continue;
    for (int r = 0; r < R; ++r) {
      float* to = sums + row.plane * values + row.pitch * static_cast<size_t>(r) + x;
      hn::StoreU(hn::LoadU(d, to) + w[r], d, to);
    }
  }
}

template <int R>
void scatter(const ScatterRow& s, int dx, int dy) {
  for (int c = 0; c < s.row.values; c += 3) {
    const bool last = c + 3 >= s.row.values;
    switch (s.row.values - c) {
      case 1:
        scatter_rows<R, 1>(s, dx, dy, c, last);
        break;
      case 2:
        scatter_rows<R, 2>(s, dx, dy, c, last);
        break;
      default:
        scatter_rows<R, 3>(s, dx, dy, c, last);
    }
  }
}

void ScatterPrediction(const ScatterRow& s, int dx, int dy, int rows) {
  rows == 2 ? scatter<2>(s, dx, dy) : scatter<1>(s, dx, dy);
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(SolveRows);
HWY_EXPORT(SolveTogether);
HWY_EXPORT(AccumulateNormal);
HWY_EXPORT(ScatterPrediction);

void solve_rows(float* a, float* b, int n, int m, int count, size_t stride, float ridge, float floor) {
  HWY_DYNAMIC_DISPATCH(SolveRows)(a, b, n, m, count, stride, ridge, floor);
}

void solve_together(double* a, double* b, double* variance, size_t n, size_t m, size_t free, const double* ridge,
                    double dependent) {
  HWY_DYNAMIC_DISPATCH(SolveTogether)(a, b, variance, n, m, free, ridge, dependent);
}

void accumulate_normal(const RegressionRow& row, const float* weights, size_t weight_step, int dy, float* scratch,
                       float* a, float* b) {
  HWY_DYNAMIC_DISPATCH(AccumulateNormal)(row, weights, weight_step, dy, scratch, a, b);
}

size_t normal_scratch(int features, int values, int radius) {
  return kRegressionLanes * static_cast<size_t>((2 * radius + 1) * (2 + 2 * features + values));
}

void scatter_prediction(const ScatterRow& row, int dx, int dy, int rows) {
  HWY_DYNAMIC_DISPATCH(ScatterPrediction)(row, dx, dy, rows);
}

}  // namespace brume::kernels
#endif
