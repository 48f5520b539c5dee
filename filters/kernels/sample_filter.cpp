#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/sample_filter.cpp"
#include "filters/kernels/sample_filter.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <bit>
#include <cstdint>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

#include "filters/kernels/exp_minus.h"

constexpr size_t kMostComponents = 64;

// The pixel's samples are the lanes: a neighbour's component is one number for all of them.
template <size_t kLanes>
void filter(std::span<const float* const> own, std::span<const float* const> others,
            std::span<const float* const> colors, std::span<const ScaledComponent> components, float (*sums)[16]) {
  float mine[kMostComponents][kLanes];
  const size_t n = components.size() < kMostComponents ? components.size() : kMostComponents;
  for (size_t k = 0; k < n; ++k)
    for (size_t i = 0; i < kLanes; ++i)
      mine[k][i] = components[k].scale * own[i < own.size() ? i : 0][components[k].index];
  float weight[kLanes] = {}, r[kLanes] = {}, g[kLanes] = {}, b[kLanes] = {};
  for (size_t j = 0; j < others.size(); ++j) {
    float distance[kLanes] = {};
    for (size_t k = 0; k < n; ++k) {
      const float value = components[k].scale * others[j][components[k].index];
      for (size_t i = 0; i < kLanes; ++i) distance[i] += (mine[k][i] - value) * (mine[k][i] - value);
    }
    const float cr = colors[j][0], cg = colors[j][1], cb = colors[j][2];
    for (size_t i = 0; i < kLanes; ++i) {
      const float w = exp_minus(distance[i]);
      weight[i] += w, r[i] += w * cr, g[i] += w * cg, b[i] += w * cb;
    }
  }
  for (size_t i = 0; i < kLanes; ++i) sums[0][i] = weight[i], sums[1][i] = r[i], sums[2][i] = g[i], sums[3][i] = b[i];
}

void FilterSamples(std::span<const float* const> own, std::span<const float* const> others,
                   std::span<const float* const> colors, std::span<const ScaledComponent> components,
                   float (*sums)[16]) {
  own.size() <= 8 ? filter<8>(own, others, colors, components, sums)
                  : filter<16>(own, others, colors, components, sums);
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(FilterSamples);

void filter_samples(std::span<const float* const> own, std::span<const float* const> others,
                    std::span<const float* const> colors, std::span<const ScaledComponent> components,
                    float (*sums)[16]) {
  HWY_DYNAMIC_DISPATCH(FilterSamples)(own, others, colors, components, sums);
}

}  // namespace brume::kernels
#endif
