#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/mixing.cpp"
#include "filters/kernels/mixing.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <cmath>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

constexpr float kLargeValue = 1.5f;  // of the largest value over the pixels of a window, taken off a gain

HWY_INLINE float smaller(float a, float b) {
  return a < b ? a : b;
}
HWY_INLINE float larger(float a, float b) {
  return a > b ? a : b;
}

void StepRow(const HalfRows& from, const HalfRows& to, const HalfRows& data, const float* HWY_RESTRICT weight,
             float* HWY_RESTRICT gain, float* HWY_RESTRICT loss, int width) {
  for (size_t c = 0; c < 3; ++c) {
    const float *from_a = from.of[c], *from_b = from.of[3 + c], *to_a = to.of[c], *to_b = to.of[3 + c],
                *data_a = data.of[c], *data_b = data.of[3 + c];
    for (int x = 0; x < width; ++x) {
      const float ta = from_a[x], tb = from_b[x], da = to_a[x] - ta, db = to_b[x] - tb, w = weight[x] * (1.0f / 3);
      const float g = w * (0.5f * ((data_b[x] - ta) * da + (data_a[x] - tb) * db) + 0.25f * (tb - ta) * (db - da));
      const float l = w * (0.25f * (da + db) * (da + db));
      gain[x] = c == 0 ? g : gain[x] + g;
      loss[x] = c == 0 ? l : loss[x] + l;
    }
  }
}

void MeasureRow(const float* HWY_RESTRICT share, const float* HWY_RESTRICT gain, const float* HWY_RESTRICT loss,
                float most, float* const* sums, int width) {
  float *HWY_RESTRICT n = sums[0], *HWY_RESTRICT g1 = sums[1], *HWY_RESTRICT g2 = sums[2], *HWY_RESTRICT g4 = sums[3],
                      *HWY_RESTRICT l = sums[4];
  for (int x = 0; x < width; ++x) {
    const float w = share[x], g = smaller(larger(gain[x], -most), most), square = w * g * g;
    n[x] += w;
    g1[x] += w * g;
    g2[x] += square;
    g4[x] += square * g * g;
    l[x] += w * loss[x];
  }
}

void HalveRow(const float* HWY_RESTRICT in, float factor, float* HWY_RESTRICT out, int width) {
  for (int x = 0; x < width; ++x) out[x] = factor * (in[2 * x] + in[2 * x + 1]);
}

bool SureRow(const float* const* means, float sure, float pixels, float* HWY_RESTRICT gain, float* HWY_RESTRICT share,
             int width) {
  constexpr int kRun = 16;
  const float *of_region = means[0], *of_gain = means[1], *of_square = means[2], *of_fourth = means[3],
              *of_loss = means[4];
  int any = 0;
  for (int first = 0; first < width; first += kRun) {
    const int last = first + kRun < width ? first + kRun : width;
    int possible = 0;
    for (int x = first; x < last; ++x) {
      gain[x] = share[x] = 0;
      possible |= of_gain[x] > 0;
    }
    if (!possible) continue;
    for (int x = first; x < last; ++x) {
      const float n = larger(of_region[x], 1e-6f), inverse = 1.0f / n, count = pixels * n;
      const float b = of_gain[x] * inverse, variance = larger(of_square[x] * inverse - b * b, 0.0f);
      const float largest = std::sqrt(std::sqrt(of_fourth[x] * inverse * count));
      const float low = b - (sure * std::sqrt(variance * count) + kLargeValue * largest) / count;
      const bool proven = of_region[x] > 1e-6f && low > 0;
      const float a = larger(of_loss[x] * inverse, 1e-30f), s = smaller(low / a, 1.0f);
      share[x] = proven ? s : 0.0f;
      gain[x] = proven ? s * (2 * low - s * a) : 0.0f;
      any |= proven;
    }
  }
  return any != 0;
}

void TakeRow(const BlockPlaces& at, const float* HWY_RESTRICT gains, const float* HWY_RESTRICT shares,
             const float* HWY_RESTRICT region, int proposal, float* HWY_RESTRICT best_gain,
             float* HWY_RESTRICT best_share, int* HWY_RESTRICT best_proposal, int width) {
  for (int x = 0; x < width; ++x) {
    const int i = at.first[x], j = at.second[x];
    const float found = gains[i] + at.share[x] * (gains[j] - gains[i]),
                length = shares[i] + at.share[x] * (shares[j] - shares[i]);
    const bool better = region[x] > 0 && found > best_gain[x];
    best_gain[x] = better ? found : best_gain[x];
    best_share[x] = better ? length : best_share[x];
    best_proposal[x] = better ? proposal : best_proposal[x];
  }
}

void MoveRow(const float* HWY_RESTRICT share, const float* HWY_RESTRICT spread, const float* HWY_RESTRICT weight,
             const HalfRows& before, const HalfRows& candidate, float* const* result, float* HWY_RESTRICT moved,
             int width) {
  for (int x = 0; x < width; ++x) moved[x] = spread[x] * share[x] > 0 && weight[x] > 0 ? 1.0f : moved[x];
  for (size_t i = 0; i < 6; ++i) {
    const float *b = before.of[i], *c = candidate.of[i];
    float* HWY_RESTRICT to = result[i];
    for (int x = 0; x < width; ++x) {
      const float s = spread[x] * share[x];
      to[x] += s > 0 && weight[x] > 0 ? s * (c[x] - b[x]) : 0.0f;
    }
  }
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(StepRow);
HWY_EXPORT(MeasureRow);
HWY_EXPORT(HalveRow);
HWY_EXPORT(SureRow);
HWY_EXPORT(TakeRow);
HWY_EXPORT(MoveRow);

void step_row(const HalfRows& from, const HalfRows& to, const HalfRows& data, const float* weight, float* gain,
              float* loss, int width) {
  HWY_DYNAMIC_DISPATCH(StepRow)(from, to, data, weight, gain, loss, width);
}

void measure_row(const float* share, const float* gain, const float* loss, float most, float* const* sums, int width) {
  HWY_DYNAMIC_DISPATCH(MeasureRow)(share, gain, loss, most, sums, width);
}

void halve_row(const float* in, float factor, float* out, int width) {
  HWY_DYNAMIC_DISPATCH(HalveRow)(in, factor, out, width);
}

bool sure_row(const float* const* means, float sure, float pixels, float* gain, float* share, int width) {
  return HWY_DYNAMIC_DISPATCH(SureRow)(means, sure, pixels, gain, share, width);
}

void take_row(const BlockPlaces& at, const float* gains, const float* shares, const float* region, int proposal,
              float* best_gain, float* best_share, int* best_proposal, int width) {
  HWY_DYNAMIC_DISPATCH(TakeRow)(at, gains, shares, region, proposal, best_gain, best_share, best_proposal, width);
}

void move_row(const float* share, const float* spread, const float* weight, const HalfRows& before,
              const HalfRows& candidate, float* const* result, float* moved, int width) {
  HWY_DYNAMIC_DISPATCH(MoveRow)(share, spread, weight, before, candidate, result, moved, width);
}

}  // namespace brume::kernels
#endif
