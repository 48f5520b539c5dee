#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/moments.cpp"
#include "filters/kernels/moments.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr size_t kVector = 16, kGroup = 4;

/// Four rows of products over one tile of `kTiles` vectors, held in registers while the pixels pass.
template <size_t kTiles, class D>
HWY_INLINE void add_tile(D d, const float* HWY_RESTRICT rows, const float* HWY_RESTRICT tile, size_t count,
                         size_t stride, float* HWY_RESTRICT products, size_t length) {
  static_assert(kTiles == 1 || kTiles == 2);
  const size_t lanes = hn::Lanes(d);
  auto a0 = hn::LoadU(d, products), a1 = hn::LoadU(d, products + length), a2 = hn::LoadU(d, products + 2 * length),
       a3 = hn::LoadU(d, products + 3 * length);
  auto b0 = a0, b1 = a1, b2 = a2, b3 = a3;
  if constexpr (kTiles == 2) {
    b0 = hn::LoadU(d, products + lanes);
    b1 = hn::LoadU(d, products + length + lanes);
    b2 = hn::LoadU(d, products + 2 * length + lanes);
    b3 = hn::LoadU(d, products + 3 * length + lanes);
  }
  for (size_t p = 0; p < count; ++p, rows += stride, tile += stride) {
    const auto x0 = hn::Set(d, rows[0]), x1 = hn::Set(d, rows[1]), x2 = hn::Set(d, rows[2]), x3 = hn::Set(d, rows[3]);
    const auto v = hn::LoadU(d, tile);
    a0 = hn::MulAdd(x0, v, a0);
    a1 = hn::MulAdd(x1, v, a1);
    a2 = hn::MulAdd(x2, v, a2);
    a3 = hn::MulAdd(x3, v, a3);
    if constexpr (kTiles == 2) {
      const auto u = hn::LoadU(d, tile + lanes);
      b0 = hn::MulAdd(x0, u, b0);
      b1 = hn::MulAdd(x1, u, b1);
      b2 = hn::MulAdd(x2, u, b2);
      b3 = hn::MulAdd(x3, u, b3);
    }
  }
  hn::StoreU(a0, d, products);
  hn::StoreU(a1, d, products + length);
  hn::StoreU(a2, d, products + 2 * length);
  hn::StoreU(a3, d, products + 3 * length);
  if constexpr (kTiles == 2) {
    hn::StoreU(b0, d, products + lanes);
    hn::StoreU(b1, d, products + length + lanes);
    hn::StoreU(b2, d, products + 2 * length + lanes);
    hn::StoreU(b3, d, products + 3 * length + lanes);
  }
}

/// Four pixels of four columns at a time, turned from rows of pixels to rows of columns.
void PackColumns(const ColumnRows& from, const float* HWY_RESTRICT factors, size_t count, float* const* out) {
  const float* HWY_RESTRICT base = from.rows[0];
  for (size_t k = 0; k < from.columns; k += 4) {
    size_t x = 0;
#if HWY_TARGET != HWY_SCALAR
    const hn::FixedTag<float, 4> d;
    const hn::RepartitionToWide<decltype(d)> wide;
    for (; x + 4 <= count; x += 4) {
      const auto column = [&](size_t i) {
        const auto value =
            hn::LoadU(d, from.rows[k + i] + x) - hn::Set(d, from.offsets[k + i]) * hn::LoadU(d, base + x);
        return hn::LoadU(d, factors + x) * (hn::Set(d, from.scales[k + i]) * value);
      };
      const auto a = column(0), b = column(1), c = column(2), e = column(3);
      const auto ab_low = hn::InterleaveLower(d, a, b), ab_high = hn::InterleaveUpper(d, a, b),
                 ce_low = hn::InterleaveLower(d, c, e), ce_high = hn::InterleaveUpper(d, c, e);
      const auto low = [&](auto ab, auto ce) {
        return hn::BitCast(d, hn::InterleaveLower(wide, hn::BitCast(wide, ab), hn::BitCast(wide, ce)));
      };
      const auto high = [&](auto ab, auto ce) {
        return hn::BitCast(d, hn::InterleaveUpper(wide, hn::BitCast(wide, ab), hn::BitCast(wide, ce)));
      };
      hn::StoreU(low(ab_low, ce_low), d, out[x] + k);
      hn::StoreU(high(ab_low, ce_low), d, out[x + 1] + k);
      hn::StoreU(low(ab_high, ce_high), d, out[x + 2] + k);
      hn::StoreU(high(ab_high, ce_high), d, out[x + 3] + k);
    }
#endif
    for (; x < count; ++x)
      for (size_t i = k; i < k + 4; ++i) {
        const float level = from.offsets[i] * base[x];
        out[x][i] = factors[x] * (from.scales[i] * (from.rows[i][x] - level));
      }
  }
}

void AddColumnsUp(const ColumnRows& from, const float* HWY_RESTRICT coefficients, size_t stride, size_t targets,
                  size_t count, float* const* out) {
  constexpr size_t kRun = 64;
  for (size_t t = 0; t < targets; ++t) std::fill_n(out[t], count, 0.0f);
  for (size_t first = 0; first < count; first += kRun) {
    const size_t n = std::min(kRun, count - first);
    const float* HWY_RESTRICT base = from.rows[0] + first;
    for (size_t k = 0; k < from.columns; ++k) {
      const float* HWY_RESTRICT row = from.rows[k] + first;
      float column[kRun];
      for (size_t x = 0; x < n; ++x) column[x] = from.scales[k] * (row[x] - from.offsets[k] * base[x]);
      for (size_t t = 0; t < targets; ++t) {
        const float c = coefficients[t * stride + k];
        float* HWY_RESTRICT to = out[t] + first;
        for (size_t x = 0; x < n; ++x) to[x] += c * column[x];
      }
    }
  }
}

// Sixteen sums side by side, so that their order is the same whatever the width of a vector.
void AddWeightedProducts(const float* HWY_RESTRICT weights, const float* HWY_RESTRICT u, const float* HWY_RESTRICT v,
                         size_t count, WeightedProducts& sums) {
  float w[kVector] = {}, uu[kVector] = {}, uv[kVector] = {}, vv[kVector] = {};
  const auto add = [&](size_t i, size_t x) HWY_ATTR {
    const float wu = weights[x] * u[x], wv = weights[x] * v[x];
    w[i] += weights[x];
    uu[i] += wu * u[x];
    uv[i] += wu * v[x];
    vv[i] += wv * v[x];
  };
  size_t x = 0;
  for (; x + kVector <= count; x += kVector)
    for (size_t i = 0; i < kVector; ++i) add(i, x + i);
  for (size_t i = 0; x < count; ++x, ++i) add(i, x);
  for (size_t i = 0; i < kVector; ++i) {
    sums.weights += static_cast<double>(w[i]);
    sums.uu += static_cast<double>(uu[i]);
    sums.uv += static_cast<double>(uv[i]);
    sums.vv += static_cast<double>(vv[i]);
  }
}

void AddProducts(const float* HWY_RESTRICT vectors, size_t count, size_t stride, size_t columns,
                 float* HWY_RESTRICT products) {
  const hn::CappedTag<float, kVector> d;
  const size_t lanes = hn::Lanes(d);
  for (size_t i = 0; i < columns; i += kGroup) {
    const size_t first = i / kVector * kVector, length = stride - first;
    size_t j = first;
    for (; j + 2 * lanes <= stride; j += 2 * lanes)
      add_tile<2>(d, vectors + i, vectors + j, count, stride, products + (j - first), length);
    for (; j < stride; j += lanes)
      add_tile<1>(d, vectors + i, vectors + j, count, stride, products + (j - first), length);
    products += kGroup * length;
  }
}

void PredictRow(const float* HWY_RESTRICT vectors, size_t width, const CoefficientRow& row, float* const* out) {
  const hn::CappedTag<float, kVector> d;
  const size_t lanes = hn::Lanes(d);
  for (size_t x = 0; x < width; ++x, vectors += row.vector) {
    const float* c0 = row.coefficients + static_cast<size_t>(row.nodes[3 * x]) * row.node;
    const float* c1 = row.coefficients + static_cast<size_t>(row.nodes[3 * x + 1]) * row.node;
    const float* c2 = row.coefficients + static_cast<size_t>(row.nodes[3 * x + 2]) * row.node;
    const auto w0 = hn::Set(d, row.weights[3 * x]), w1 = hn::Set(d, row.weights[3 * x + 1]),
               w2 = hn::Set(d, row.weights[3 * x + 2]);
    for (size_t t = 0; t < row.targets; ++t, c0 += row.stride, c1 += row.stride, c2 += row.stride) {
      auto sum = hn::Zero(d);
      for (size_t k = 0; k < row.used; k += lanes) {
        const auto c =
            hn::MulAdd(w0, hn::LoadU(d, c0 + k), hn::MulAdd(w1, hn::LoadU(d, c1 + k), w2 * hn::LoadU(d, c2 + k)));
        sum = hn::MulAdd(c, hn::LoadU(d, vectors + k), sum);
      }
      out[t][x] = hn::GetLane(hn::SumOfLanes(d, sum));
    }
  }
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(PackColumns);
HWY_EXPORT(AddColumnsUp);
HWY_EXPORT(AddWeightedProducts);
HWY_EXPORT(AddProducts);
HWY_EXPORT(PredictRow);

size_t product_index(size_t i, size_t j, size_t stride) {
  // Groups of four rows; all groups of one vector of columns are equally long.
  const size_t vector = i / 16, first = vector * 16;
  const size_t before = 16 * vector * stride - (vector == 0 ? 0 : 128 * vector * (vector - 1));
  return before + (i - first) * (stride - first) + j - first;
}

size_t product_floats(size_t columns, size_t stride) {
  size_t floats = 0;
  for (size_t i = 0; i < columns; i += 4) floats += 4 * (stride - i / 16 * 16);
  return floats;
}

void pack_columns(const ColumnRows& from, const float* factors, size_t count, float* const* out) {
  HWY_DYNAMIC_DISPATCH(PackColumns)(from, factors, count, out);
}

void add_columns_up(const ColumnRows& from, const float* coefficients, size_t stride, size_t targets, size_t count,
                    float* const* out) {
  HWY_DYNAMIC_DISPATCH(AddColumnsUp)(from, coefficients, stride, targets, count, out);
}

void add_weighted_products(const float* weights, const float* u, const float* v, size_t count, WeightedProducts& sums) {
  HWY_DYNAMIC_DISPATCH(AddWeightedProducts)(weights, u, v, count, sums);
}

void add_products(const float* vectors, size_t count, size_t stride, size_t columns, float* products) {
  HWY_DYNAMIC_DISPATCH(AddProducts)(vectors, count, stride, columns, products);
}

void predict_row(const float* vectors, size_t width, const CoefficientRow& row, float* const* out) {
  HWY_DYNAMIC_DISPATCH(PredictRow)(vectors, width, row, out);
}

}  // namespace brume::kernels
#endif
