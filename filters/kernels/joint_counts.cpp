#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/joint_counts.cpp"
#include "filters/kernels/joint_counts.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <bit>

// Population counts are one instruction from SSE4 on, which the baseline does not have.
HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

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

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(JointCounts);

void joint_counts(const uint64_t* first, const uint64_t* second, const int* first_counts, const int* second_counts,
                  int bins, size_t words, int* joint) {
  HWY_DYNAMIC_DISPATCH(JointCounts)(first, second, first_counts, second_counts, bins, words, joint);
}

}  // namespace brume::kernels
#endif
