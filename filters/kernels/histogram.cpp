#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/histogram.cpp"
#include "filters/kernels/histogram.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <cmath>

// Plain loops over x, compiled for every instruction set: see kernels/rows.h.
HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

void HistogramDistanceRow(const float* h1, const float* h2, const float* n1, const float* n2, int bins,
                          size_t bin_stride, int count, float* HWY_RESTRICT sum, float* HWY_RESTRICT counted) {
  constexpr int kChunk = 64;
  for (int first = 0; first < count; first += kChunk) {
    const int n = count - first < kChunk ? count - first : kChunk;
    float ratio[kChunk], inverse[kChunk], total[kChunk] = {}, used[kChunk] = {};
    for (int x = 0; x < n; ++x) {
      const float a = n1[first + x] > 0 ? n1[first + x] : 1.0f, b = n2[first + x] > 0 ? n2[first + x] : 1.0f;
      ratio[x] = std::sqrt(b / a);
      inverse[x] = 1.0f / ratio[x];
    }
    for (int bin = 0; bin < bins; ++bin) {
      const float *a = h1 + bin_stride * static_cast<size_t>(bin) + first,
                  *b = h2 + bin_stride * static_cast<size_t>(bin) + first;
      for (int x = 0; x < n; ++x) {
        const float both = a[x] + b[x], d = ratio[x] * a[x] - inverse[x] * b[x];
        const bool enough = both > 1.0f;
        total[x] += enough ? d * d / both : 0.0f;
        used[x] += enough ? 1.0f : 0.0f;
      }
    }
    for (int x = 0; x < n; ++x) sum[first + x] = total[x], counted[first + x] = used[x];
  }
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
