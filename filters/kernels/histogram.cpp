#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/histogram.cpp"
#include "filters/kernels/histogram.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// The pairs from `x` on that fill whole vectors of D; returns the first that is left.
template <class D>
HWY_INLINE int distance_vectors(D d, const float* h1, const float* h2, const float* n1, const float* n2, int bins,
                                size_t bin_stride, int x, int count, float* sum, float* counted) {
  using V = hn::Vec<D>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  for (; x + lanes <= count; x += lanes) {
    const V r = hn::Sqrt(hn::Max(hn::LoadU(d, n2 + x), one) / hn::Max(hn::LoadU(d, n1 + x), one));
    const V inverse = one / r;
    V total = zero, used = zero;
    const float *a = h1 + x, *b = h2 + x;
    for (int bin = 0; bin < bins; ++bin, a += bin_stride, b += bin_stride) {
      const V p = hn::LoadU(d, a), q = hn::LoadU(d, b), both = p + q;
      const auto enough = hn::Gt(both, one);
      const V difference = hn::NegMulAdd(inverse, q, r * p);
      // 1 / both to 22 bits: an estimate, and one step of Newton's.
      const V guess = hn::ApproximateReciprocal(hn::Max(both, one));
      const V reciprocal = guess * hn::NegMulAdd(hn::Max(both, one), guess, hn::Set(d, 2.0f));
      total = hn::MulAdd(difference * difference, hn::IfThenElseZero(enough, reciprocal), total);
      used += hn::IfThenElseZero(enough, one);
    }
    hn::StoreU(total, d, sum + x);
    hn::StoreU(used, d, counted + x);
  }
  return x;
}

void HistogramDistanceRow(const float* h1, const float* h2, const float* n1, const float* n2, int bins,
                          size_t bin_stride, int count, float* sum, float* counted) {
  int x = distance_vectors(hn::ScalableTag<float>(), h1, h2, n1, n2, bins, bin_stride, 0, count, sum, counted);
  x = distance_vectors(hn::CappedTag<float, 4>(), h1, h2, n1, n2, bins, bin_stride, x, count, sum, counted);
  distance_vectors(hn::CappedTag<float, 1>(), h1, h2, n1, n2, bins, bin_stride, x, count, sum, counted);
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(HistogramDistanceRow);

void histogram_distance_row(const float* h1, const float* h2, const float* n1, const float* n2, int bins,
                            size_t bin_stride, int count, float* sum, float* counted) {
  HWY_DYNAMIC_DISPATCH(HistogramDistanceRow)(h1, h2, n1, n2, bins, bin_stride, count, sum, counted);
}

}  // namespace brume::kernels
#endif
