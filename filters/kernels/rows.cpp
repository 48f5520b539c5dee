#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/rows.cpp"
#include "filters/kernels/rows.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

void BoxRow(const float* HWY_RESTRICT in, float* HWY_RESTRICT out, int width, int radius) {
  for (int x = 0; x < width; ++x) out[x] = in[x];
  for (int j = 1; j <= std::min(radius, width - 1); ++j) {
    for (int x = 0; x < width - j; ++x) out[x] += in[x + j];
    for (int x = j; x < width; ++x) out[x] += in[x - j];
  }
}

void SumRows(const float* const* rows, int count, float* HWY_RESTRICT out, int width) {
  for (int x = 0; x < width; ++x) out[x] = rows[0][x];
  int i = 1;
  for (; i + 3 < count; i += 4) {
    const float *a = rows[i], *b = rows[i + 1], *c = rows[i + 2], *d = rows[i + 3];
    for (int x = 0; x < width; ++x) out[x] += (a[x] + b[x]) + (c[x] + d[x]);
  }
  for (; i < count; ++i) {
    const float* a = rows[i];
    for (int x = 0; x < width; ++x) out[x] += a[x];
  }
}

void WeightedSumRows(const float* const* rows, const float* weights, int count, float* HWY_RESTRICT out, int width) {
  const float* first = rows[0];
  for (int x = 0; x < width; ++x) out[x] = weights[0] * first[x];
  int i = 1;
  for (; i + 3 < count; i += 4) {
    const float *a = rows[i], *b = rows[i + 1], *c = rows[i + 2], *d = rows[i + 3];
    const float wa = weights[i], wb = weights[i + 1], wc = weights[i + 2], wd = weights[i + 3];
    for (int x = 0; x < width; ++x) out[x] += (wa * a[x] + wb * b[x]) + (wc * c[x] + wd * d[x]);
  }
  for (; i < count; ++i) {
    const float* a = rows[i];
    const float w = weights[i];
    for (int x = 0; x < width; ++x) out[x] += w * a[x];
  }
}

HWY_INLINE float larger(float a, float b) {
  return a > b ? a : b;
}

/// w with `by` off its size, or 0.
HWY_INLINE float shrunk(float w, float by) {
  return std::copysign(larger(0.0f, std::abs(w) - by), w);
}

void ShrinkRow(Shrink rule, float strength, float gain, const float* HWY_RESTRICT fine,
               const float* HWY_RESTRICT coarse, const float* HWY_RESTRICT variance, const float* HWY_RESTRICT energy,
               float* HWY_RESTRICT sum, int width) {
  switch (rule) {
    case Shrink::kSoft:
      for (int x = 0; x < width; ++x) sum[x] += shrunk(fine[x] - coarse[x], strength * std::sqrt(gain * variance[x]));
      break;
    case Shrink::kBayes:
      for (int x = 0; x < width; ++x) {
        const float w = fine[x] - coarse[x], noise = gain * variance[x], signal = larger(0.0f, energy[x] - noise);
        const float kept = shrunk(w, strength * noise / std::sqrt(larger(signal, 1e-30f)));
        sum[x] += signal > 1e-30f ? kept : 0.0f;
      }
      break;
  }
}

HWY_INLINE void order(float& a, float& b) {
  const float low = a < b ? a : b, high = a < b ? b : a;
  a = low;
  b = high;
}

// Nineteen exchanges bring the median of nine to the middle. Source: Devillard 1998, Fast median search.
HWY_INLINE float median9(float a, float b, float c, float d, float e, float f, float g, float h, float i) {
  order(b, c);
  order(e, f);
  order(h, i);
  order(a, b);
  order(d, e);
  order(g, h);
  order(b, c);
  order(e, f);
  order(h, i);
  order(a, d);
  order(f, i);
  order(e, h);
  order(d, g);
  order(b, e);
  order(c, f);
  order(e, h);
  order(e, c);
  order(g, e);
  order(e, c);
  return e;
}

void Median9Row(const float* HWY_RESTRICT above, const float* HWY_RESTRICT row, const float* HWY_RESTRICT below,
                float* HWY_RESTRICT out, int width) {
  const auto at = [&](int x) {
    const int l = std::max(0, x - 1), r = std::min(width - 1, x + 1);
    return median9(above[l], above[x], above[r], row[l], row[x], row[r], below[l], below[x], below[r]);
  };
  out[0] = at(0);
  for (int x = 1; x < width - 1; ++x)
    out[x] = median9(above[x - 1], above[x], above[x + 1], row[x - 1], row[x], row[x + 1], below[x - 1], below[x],
                     below[x + 1]);
  out[width - 1] = at(width - 1);
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(BoxRow);
HWY_EXPORT(SumRows);
HWY_EXPORT(WeightedSumRows);
HWY_EXPORT(Median9Row);
HWY_EXPORT(ShrinkRow);

void box_row(const float* in, float* out, int width, int radius) {
  HWY_DYNAMIC_DISPATCH(BoxRow)(in, out, width, radius);
}

void sum_rows(const float* const* rows, int count, float* out, int width) {
  HWY_DYNAMIC_DISPATCH(SumRows)(rows, count, out, width);
}

void weighted_sum_rows(const float* const* rows, const float* weights, int count, float* out, int width) {
  HWY_DYNAMIC_DISPATCH(WeightedSumRows)(rows, weights, count, out, width);
}

void shrink_row(Shrink rule, float strength, float gain, const float* fine, const float* coarse, const float* variance,
                const float* energy, float* sum, int width) {
  HWY_DYNAMIC_DISPATCH(ShrinkRow)(rule, strength, gain, fine, coarse, variance, energy, sum, width);
}

void median9_row(const float* above, const float* row, const float* below, float* out, int width) {
  HWY_DYNAMIC_DISPATCH(Median9Row)(above, row, below, out, width);
}

}  // namespace brume::kernels
#endif
