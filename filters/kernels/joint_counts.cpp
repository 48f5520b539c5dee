#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/joint_counts.cpp"
#include "filters/kernels/joint_counts.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cstring>

// Population counts are one instruction from SSE4 on, which the baseline does not have.
HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

constexpr int kMostBins = 16;

void JointCounts(const uint64_t* first, const uint64_t* second, const int* first_counts, const int* second_counts,
                 int bins, size_t words, int* joint) {
  for (int i = 0; i < bins; ++i) {
    const uint64_t* const x = first + static_cast<size_t>(i) * words;
    int left = first_counts[i];
    for (int j = 0; j < bins; ++j) {
      int count = 0;
      if (left > 0 && second_counts[j] > 0) {
        const uint64_t* const y = second + static_cast<size_t>(j) * words;
        for (size_t w = 0; w < words; ++w) count += std::popcount(x[w] & y[w]);
      }
      joint[i * bins + j] = count;
      left -= count;
    }
  }
}

void BinBits(const float* column, size_t count, int bins, size_t words, uint64_t* sets, int* counts) {
  namespace hn = hwy::HWY_NAMESPACE;
  const hn::CappedTag<float, 64> d;
  const hn::RebindToSigned<decltype(d)> di;
  const size_t lanes = hn::Lanes(d);
  const auto outermost = hn::Set(d, static_cast<float>(bins / 2));
  const auto middle = hn::Set(di, bins / 2);
  for (int b = 0; b < bins; ++b) counts[b] = 0;
  for (size_t w = 0; w < words; ++w) {
    float values[64];
    const size_t here = count - 64 * w < 64 ? count - 64 * w : 64;
    std::memcpy(values, column + 64 * w, here * sizeof(float));
    std::fill(values + here, values + 64, 0.0f);
    uint64_t bits[kMostBins] = {};
    for (size_t i = 0; i < 64; i += lanes) {
      const auto v = hn::Min(hn::Max(hn::LoadU(d, values + i), hn::Neg(outermost)), outermost);
      const auto bin = hn::NearestInt(v) + middle;
      for (int b = 0; b < bins; ++b) {
        uint8_t packed[8] = {};
        hn::StoreMaskBits(di, hn::Eq(bin, hn::Set(di, b)), packed);
        uint64_t word;
        std::memcpy(&word, packed, 8);
        bits[b] |= word << i;
      }
    }
    const uint64_t valid = here == 64 ? ~uint64_t{0} : (uint64_t{1} << here) - 1;
    for (int b = 0; b < bins; ++b) {
      sets[static_cast<size_t>(b) * words + w] = bits[b] & valid;
      counts[b] += std::popcount(bits[b] & valid);
    }
  }
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(JointCounts);
HWY_EXPORT(BinBits);

void joint_counts(const uint64_t* first, const uint64_t* second, const int* first_counts, const int* second_counts,
                  int bins, size_t words, int* joint) {
  HWY_DYNAMIC_DISPATCH(JointCounts)(first, second, first_counts, second_counts, bins, words, joint);
}

void bin_bits(const float* column, size_t count, int bins, size_t words, uint64_t* sets, int* counts) {
  HWY_DYNAMIC_DISPATCH(BinBits)(column, count, bins, words, sets, counts);
}

}  // namespace brume::kernels
#endif
