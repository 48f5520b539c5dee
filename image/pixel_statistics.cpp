#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "image/pixel_statistics.cpp"
#include "image/pixel_statistics.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <type_traits>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Adds every step-th row, or its squares, to the sums of one block (high parts, then low parts), from column i on, as
/// long as kAtOnce whole vectors are left. Each addition waits for the one before: several columns of them overlap.
template <bool kSquares, size_t kAtOnce, class D>
HWY_INLINE void add_columns(D d, size_t& i, double* state, size_t values, const float* rows, size_t count, size_t first,
                            size_t step) {
  const hn::Rebind<float, D> d_float;
  const size_t lanes = hn::Lanes(d);
  for (; i + kAtOnce * lanes <= values; i += kAtOnce * lanes) {
    hn::Vec<D> high[kAtOnce], low[kAtOnce];
    for (size_t k = 0; k < kAtOnce; ++k)
      high[k] = hn::LoadU(d, state + i + k * lanes), low[k] = hn::LoadU(d, state + values + i + k * lanes);
    for (size_t s = first; s < count; s += step)
      for (size_t k = 0; k < kAtOnce; ++k) {
        auto x = hn::PromoteTo(d, hn::LoadU(d_float, rows + s * values + i + k * lanes));
        if (kSquares) x = hn::Mul(x, x);  // exact: 48 bits
        // Without error (Knuth's two-sum), then normalised.
        const auto sum = hn::Add(high[k], x), b = hn::Sub(sum, high[k]);
        const auto l = hn::Add(low[k], hn::Add(hn::Sub(high[k], hn::Sub(sum, b)), hn::Sub(x, b)));
        high[k] = hn::Add(sum, l);
        low[k] = hn::Sub(l, hn::Sub(high[k], sum));
      }
    for (size_t k = 0; k < kAtOnce; ++k)
      hn::StoreU(high[k], d, state + i + k * lanes), hn::StoreU(low[k], d, state + values + i + k * lanes);
  }
}

template <bool kSquares>
HWY_INLINE void add_rows(double* state, size_t values, const float* rows, size_t count, size_t first, size_t step) {
  size_t i = 0;
  const auto add = [&](auto at_once, auto d) {
    add_columns<kSquares, decltype(at_once)::value>(d, i, state, values, rows, count, first, step);
  };
  using One = std::integral_constant<size_t, 1>;
  add(std::integral_constant<size_t, 4>(), hn::ScalableTag<double>());
  add(std::integral_constant<size_t, 2>(), hn::ScalableTag<double>());
  add(One(), hn::ScalableTag<double>());
  add(One(), hn::CappedTag<double, 4>());
  add(One(), hn::CappedTag<double, 2>());
  add(One(), hn::CappedTag<double, 1>());
}

void AddSamples(double* state, const float* rows, size_t count, size_t first, const PixelSums& sums) {
  const size_t values = sums.values(), groups = sums.groups();
  for (size_t g = 0; g < groups; ++g)
    add_rows<false>(state + 2 * values * g, values, rows, count, (g + groups - first % groups) % groups, groups);
  if (sums.squares()) add_rows<true>(state + 2 * values * groups, values, rows, count, 0, 1);
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(AddSamples);

void PixelSums::add(double* state, const float* rows, size_t count, size_t first) const {
  HWY_DYNAMIC_DISPATCH(AddSamples)(state, rows, count, first, *this);
}

}  // namespace brume
#endif
