#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "image/pixel_statistics.cpp"
#include "image/pixel_statistics.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Adds every step-th row, or its squares, to the sums of one block (high parts, then low parts), from column i on, in
/// whole vectors. Returns the first column left over.
template <bool kSquares, class D>
HWY_INLINE size_t add_columns(D d, size_t i, double* state, size_t values, const float* rows, size_t count,
                              size_t first, size_t step) {
  const hn::Rebind<float, D> d_float;
  for (; i + hn::Lanes(d) <= values; i += hn::Lanes(d)) {
    auto high = hn::LoadU(d, state + i), low = hn::LoadU(d, state + values + i);
    for (size_t s = first; s < count; s += step) {
      auto x = hn::PromoteTo(d, hn::LoadU(d_float, rows + s * values + i));
      if (kSquares) x = hn::Mul(x, x);  // exact: 48 bits
      // Without error (Knuth's two-sum), then normalised.
      const auto sum = hn::Add(high, x), b = hn::Sub(sum, high);
      const auto l = hn::Add(low, hn::Add(hn::Sub(high, hn::Sub(sum, b)), hn::Sub(x, b)));
      high = hn::Add(sum, l);
      low = hn::Sub(l, hn::Sub(high, sum));
    }
    hn::StoreU(high, d, state + i);
    hn::StoreU(low, d, state + values + i);
  }
  return i;
}

template <bool kSquares>
HWY_INLINE void add_rows(double* state, size_t values, const float* rows, size_t count, size_t first, size_t step) {
  const size_t i = add_columns<kSquares>(hn::ScalableTag<double>(), 0, state, values, rows, count, first, step);
  add_columns<kSquares>(hn::CappedTag<double, 1>(), i, state, values, rows, count, first, step);
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
