#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/convolution.cpp"
#include "filters/kernels/convolution.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kBlock>;
using V = hn::Vec<D>;

constexpr int kLanes = static_cast<int>(hn::MaxLanes(D())), kVectors = kBlock / kLanes;
// Pixels at once, so that their sums stay in registers: AVX-512 has 32 of them, others at least 16.
constexpr int kPixels = kLanes == 16 ? 14 : std::max(1, 12 / kVectors);
static_assert(kPixels <= kBeyond + 1);

/// kPixels pixels from `first` on, kBlocks blocks from `block` on.
template <int kBlocks>
HWY_INLINE void convolve_pixels(const ConvolvedRow& r, int first, int block) {
  constexpr int kSums = kBlocks * kVectors;
  const D d;
  V sum[kPixels][kSums];
#pragma GCC unroll 16
  for (int s = 0; s < kSums; ++s)
#pragma GCC unroll 16
    for (int i = 0; i < kPixels; ++i) sum[i][s] = hn::LoadU(d, r.bias + block * kBlock + s * kLanes);
  for (size_t t = 0; t < r.count; ++t) {
    const Tap& tap = r.taps[t];
    const ptrdiff_t step = tap.step;
    const float* HWY_RESTRICT in = tap.input + first * step;
    const float* HWY_RESTRICT weights = tap.weights + block * r.weights_stride;
    for (int c = 0; c < tap.inputs; ++c, ++in, weights += kBlock) {
      V w[kSums];
#pragma GCC unroll 16
      for (int s = 0; s < kSums; ++s)
        w[s] = hn::LoadU(d, weights + s / kVectors * r.weights_stride + s % kVectors * kLanes);
#pragma GCC unroll 16
      for (int i = 0; i < kPixels; ++i) {
        const V value = hn::Set(d, in[i * step]);
#pragma GCC unroll 16
        for (int s = 0; s < kSums; ++s) sum[i][s] = hn::MulAdd(value, w[s], sum[i][s]);
      }
    }
  }
  const V lowest = hn::Set(d, r.lowest);
#pragma GCC unroll 16
  for (int i = 0; i < kPixels; ++i)
#pragma GCC unroll 16
    for (int s = 0; s < kSums; ++s)
      hn::StoreU(hn::Max(sum[i][s], lowest), d,
                 r.out + (first + i) * r.step + (block + s / kVectors) * r.out_stride + s % kVectors * kLanes);
}

void ConvolveRow(const ConvolvedRow& row) {
  constexpr int kTogether = kLanes == 16 ? 2 : 1;  // blocks
  int block = 0;
  for (; block + kTogether <= row.blocks; block += kTogether)
    for (int x = 0; x < row.pixels; x += kPixels) convolve_pixels<kTogether>(row, x, block);
  for (; block < row.blocks; ++block)
    for (int x = 0; x < row.pixels; x += kPixels) convolve_pixels<1>(row, x, block);
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(ConvolveRow);

void convolve_row(const ConvolvedRow& row) {
  HWY_DYNAMIC_DISPATCH(ConvolveRow)(row);
}

}  // namespace brume::kernels
#endif
