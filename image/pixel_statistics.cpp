#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "image/pixel_statistics.cpp"
#include "image/pixel_statistics.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <type_traits>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class V>
struct Sum {  // high + low
  V high, low;
};
/// Without error (Knuth's two-sum).
template <class V>
HWY_INLINE Sum<V> two_sum(V a, V b) {
  const V sum = hn::Add(a, b), part = hn::Sub(sum, a);
  return {sum, hn::Add(hn::Sub(a, hn::Sub(sum, part)), hn::Sub(b, part))};
}
/// Without error (Dekker), whether or not there is a fused multiply-add.
template <class V>
HWY_INLINE Sum<V> two_product(V a, V b) {
  const auto split = [](V v) {
    const V scaled = hn::Mul(v, hn::Set(hn::DFromV<V>(), 0x1p27 + 1)), high = hn::Sub(scaled, hn::Sub(scaled, v));
    return Sum<V>{high, hn::Sub(v, high)};
  };
  const Sum<V> x = split(a), y = split(b);
  const V product = hn::Mul(a, b), crossed = hn::Add(hn::Mul(x.high, y.low), hn::Mul(x.low, y.high));
  return {product, hn::Add(hn::Mul(x.low, y.low), hn::Add(hn::Sub(hn::Mul(x.high, y.high), product), crossed))};
}
template <class V>
HWY_INLINE Sum<V> accumulated(Sum<V> total, V x) {
  const Sum<V> sum = two_sum(total.high, x);
  const V low = hn::Add(total.low, sum.low), high = hn::Add(sum.high, low);
  return {high, hn::Sub(low, hn::Sub(high, sum.high))};
}

/// Adds every step-th row, or its squares, to the sums of one block (high parts, then low parts), from column i on, as
/// long as kAtOnce whole vectors are left. Each addition waits for the one before: several columns of them overlap.
template <bool kSquares, size_t kAtOnce, class D>
HWY_INLINE void add_columns(D d, size_t& i, double* state, size_t values, const float* rows, size_t count, size_t first,
                            size_t step) {
  const hn::Rebind<float, D> d_float;
  const size_t lanes = hn::Lanes(d);
  for (; i + kAtOnce * lanes <= values; i += kAtOnce * lanes) {
    Sum<hn::Vec<D>> sums[kAtOnce];
    for (size_t k = 0; k < kAtOnce; ++k)
      sums[k] = {hn::LoadU(d, state + i + k * lanes), hn::LoadU(d, state + values + i + k * lanes)};
    for (size_t s = first; s < count; s += step)
      for (size_t k = 0; k < kAtOnce; ++k) {
        auto x = hn::PromoteTo(d, hn::LoadU(d_float, rows + s * values + i + k * lanes));
        if (kSquares) x = hn::Mul(x, x);  // exact: 48 bits
        sums[k] = accumulated(sums[k], x);
      }
    for (size_t k = 0; k < kAtOnce; ++k) {
      hn::StoreU(sums[k].high, d, state + i + k * lanes);
      hn::StoreU(sums[k].low, d, state + values + i + k * lanes);
    }
  }
}

/// Shorter and shorter vectors, down to single values.
template <class Visit>
HWY_INLINE void for_each_width(const Visit& visit) {
  visit(hn::ScalableTag<double>());
  visit(hn::CappedTag<double, 4>());
  visit(hn::CappedTag<double, 2>());
  visit(hn::CappedTag<double, 1>());
}

template <bool kSquares>
HWY_INLINE void add_rows(double* state, size_t values, const float* rows, size_t count, size_t first, size_t step) {
  size_t i = 0;
  const auto add = [&](auto at_once, auto d) {
    add_columns<kSquares, decltype(at_once)::value>(d, i, state, values, rows, count, first, step);
  };
  add(std::integral_constant<size_t, 4>(), hn::ScalableTag<double>());
  add(std::integral_constant<size_t, 2>(), hn::ScalableTag<double>());
  for_each_width([&](auto d) { add(std::integral_constant<size_t, 1>(), d); });
}

void AddSamples(double* state, const float* rows, size_t count, size_t first, const PixelSums& sums) {
  const size_t values = sums.values(), groups = sums.groups();
  for (size_t g = 0; g < groups; ++g)
    add_rows<false>(state + 2 * values * g, values, rows, count, (g + groups - first % groups) % groups, groups);
  if (sums.squares()) add_rows<true>(state + 2 * values * groups, values, rows, count, 0, 1);
}

void Means(const double* state, size_t first_group, size_t step, double n, double* result, const PixelSums& sums) {
  const size_t values = sums.values();
  size_t i = 0;
  for_each_width([&](auto d) {
    for (; i + hn::Lanes(d) <= values; i += hn::Lanes(d)) {
      auto total = hn::Zero(d);
      for (size_t g = first_group; g < sums.groups(); g += step) {
        const double* const high = state + 2 * values * g + i;
        total = hn::Add(total, hn::Add(hn::LoadU(d, high), hn::LoadU(d, high + values)));
      }
      hn::StoreU(hn::Div(total, hn::Set(d, n)), d, result + i);
    }
  });
}

// The difference of nearly equal numbers, n * the sum of squares - the square of the sum: in pairs of doubles.
void MeanVariances(const double* state, double n, double* result, const PixelSums& sums) {
  const size_t values = sums.values(), groups = sums.groups();
  size_t i = 0;
  for_each_width([&](auto d) {
    using V = hn::Vec<decltype(d)>;
    const V count = hn::Set(d, n);
    for (; i + hn::Lanes(d) <= values; i += hn::Lanes(d)) {
      const auto load = [&](size_t block) {
        const double* const high = state + 2 * values * block + i;
        return Sum<V>{hn::LoadU(d, high), hn::LoadU(d, high + values)};
      };
      Sum<V> total = load(0);
      for (size_t g = 1; g < groups; ++g) total = accumulated(accumulated(total, load(g).high), load(g).low);
      const Sum<V> squares = load(groups);
      const Sum<V> a = two_product(count, squares.high), b = two_product(total.high, total.high);
      const V a_low = hn::Add(a.low, hn::Mul(count, squares.low));
      const V b_low = hn::Add(b.low, hn::Mul(hn::Add(total.high, total.high), total.low));
      const Sum<V> difference = two_sum(a.high, hn::Neg(b.high));
      const V deviation = hn::Add(difference.high, hn::Add(difference.low, hn::Sub(a_low, b_low)));
      // What is left of equal values is rounding.
      const auto differs = hn::Gt(deviation, hn::Mul(hn::Set(d, 1e-17), a.high));
      hn::StoreU(hn::IfThenElseZero(differs, hn::Div(deviation, hn::Set(d, n * n * (n - 1)))), d, result + i);
    }
  });
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(AddSamples);
HWY_EXPORT(Means);
HWY_EXPORT(MeanVariances);

void PixelSums::add(double* state, const float* rows, size_t count, size_t first) const {
  HWY_DYNAMIC_DISPATCH(AddSamples)(state, rows, count, first, *this);
}

void PixelSums::means(const double* state, size_t first_group, size_t step, uint64_t n, double* result) const {
  if (n == 0)
    std::fill_n(result, values_, 0.0);
  else
    HWY_DYNAMIC_DISPATCH(Means)(state, first_group, step, static_cast<double>(n), result, *this);
}

void PixelSums::mean_variances(const double* state, uint64_t n, double* result) const {
  if (n < 2)
    std::fill_n(result, values_, 0.0);
  else
    HWY_DYNAMIC_DISPATCH(MeanVariances)(state, static_cast<double>(n), result, *this);
}

}  // namespace brume
#endif
