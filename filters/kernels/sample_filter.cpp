#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/sample_filter.cpp"
#include "filters/kernels/sample_filter.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <bit>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

#include "filters/kernels/exp_minus.h"

constexpr size_t kMostComponents = 64;

// The pixel's samples are the lanes: a neighbour's component is one number for all of them.
template <size_t kLanes>
void filter(const float* records, size_t own, size_t count, size_t width, size_t color,
            std::span<const ScaledComponent> components, float (*sums)[16]) {
  float mine[kMostComponents][kLanes];
  const size_t n = components.size() < kMostComponents ? components.size() : kMostComponents;
  for (size_t k = 0; k < n; ++k)
    for (size_t i = 0; i < kLanes; ++i)
      mine[k][i] = components[k].scale * records[(i < own ? i : 0) * width + static_cast<size_t>(components[k].index)];
  float weight[kLanes] = {}, r[kLanes] = {}, g[kLanes] = {}, b[kLanes] = {};
  for (size_t j = 0; j < count; ++j) {
    const float* other = records + j * width;
    float distance[kLanes] = {};
    for (size_t k = 0; k < n; ++k) {
      const float value = components[k].scale * other[components[k].index];
      for (size_t i = 0; i < kLanes; ++i) distance[i] += (mine[k][i] - value) * (mine[k][i] - value);
    }
    const float cr = other[color], cg = other[color + 1], cb = other[color + 2];
    for (size_t i = 0; i < kLanes; ++i) {
      const float w = exp_minus(distance[i]);
      weight[i] += w;
      r[i] += w * cr;
      g[i] += w * cg;
      b[i] += w * cb;
    }
  }
  for (size_t i = 0; i < kLanes; ++i) {
    sums[0][i] = weight[i];
    sums[1][i] = r[i];
    sums[2][i] = g[i];
    sums[3][i] = b[i];
  }
}

void FilterSamples(const float* records, size_t own, size_t count, size_t width, size_t color,
                   std::span<const ScaledComponent> components, float (*sums)[16]) {
  own <= 8 ? filter<8>(records, own, count, width, color, components, sums)
           : filter<16>(records, own, count, width, color, components, sums);
}

void ColumnMoments(const float* records, size_t count, size_t width, size_t columns, double* HWY_RESTRICT sums,
                   double* HWY_RESTRICT squares) {
  // Short sums in float, of which doubles are made.
  constexpr size_t kRun = 32;
  for (size_t k = 0; k < columns; ++k) sums[k] = squares[k] = 0;
  for (size_t begin = 0; begin < columns; begin += kMostComponents) {
    const size_t n = columns - begin < kMostComponents ? columns - begin : kMostComponents;
    const float* const first = records + begin;
    for (size_t start = 0; start < count; start += kRun) {
      float sum[kMostComponents] = {}, square[kMostComponents] = {};
      const size_t end = start + kRun < count ? start + kRun : count;
      for (size_t i = start; i < end; ++i) {
        const float* record = records + i * width + begin;
        for (size_t k = 0; k < n; ++k) {
          const float d = record[k] - first[k];
          sum[k] += d;
          square[k] += d * d;
        }
      }
      for (size_t k = 0; k < n; ++k) {
        sums[begin + k] += static_cast<double>(sum[k]);
        squares[begin + k] += static_cast<double>(square[k]);
      }
    }
  }
}

size_t CollectRecords(std::span<const float* const> records, std::span<const float* const> colors, size_t always,
                      size_t length, const RecordBounds& bounds, float* HWY_RESTRICT to, size_t width) {
  constexpr size_t kAhead = 12;  // records lie anywhere: they are asked for in time
  const float *low = bounds.low, *high = bounds.high;
  size_t taken = 0;
  for (size_t i = 0; i < records.size(); ++i) {
    if (i + kAhead < records.size()) {
      const char* next = reinterpret_cast<const char*>(records[i + kAhead]);
      for (size_t line = 0; line < length * sizeof(float); line += 64) __builtin_prefetch(next + line);
      __builtin_prefetch(colors[i + kAhead]);
    }
    const float* record = records[i];
    const float* v = record + bounds.begin;
    int outside = 0;
    for (size_t k = 0; k < bounds.count; ++k)
      outside |= static_cast<int>(v[k] < low[k]) | static_cast<int>(v[k] > high[k]);
    if (outside && i >= always) continue;
    float* HWY_RESTRICT row = to + taken * width;
    for (size_t k = 0; k < length; ++k) row[k] = record[k];
    for (size_t k = 0; k < 3; ++k) row[length + k] = colors[i][k];
    ++taken;
  }
  return taken;
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(FilterSamples);
HWY_EXPORT(ColumnMoments);
HWY_EXPORT(CollectRecords);

void filter_samples(const float* records, size_t own, size_t count, size_t width, size_t color,
                    std::span<const ScaledComponent> components, float (*sums)[16]) {
  HWY_DYNAMIC_DISPATCH(FilterSamples)(records, own, count, width, color, components, sums);
}

void column_moments(const float* records, size_t count, size_t width, size_t columns, double* sums, double* squares) {
  HWY_DYNAMIC_DISPATCH(ColumnMoments)(records, count, width, columns, sums, squares);
}

size_t collect_records(std::span<const float* const> records, std::span<const float* const> colors, size_t always,
                       size_t length, const RecordBounds& bounds, float* to, size_t width) {
  return HWY_DYNAMIC_DISPATCH(CollectRecords)(records, colors, always, length, bounds, to, width);
}

}  // namespace brume::kernels
#endif
