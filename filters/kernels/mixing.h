#pragma once
#include <cstddef>

namespace brume::kernels {

// Rows of mixing (filters/regression/transport/mixing.h), as plain loops: see kernels/rows.h.

/// Rows of both halves of three colours: a's, then b's.
struct HalfRows {
  const float* of[6];
};

/// What a step from a result towards a candidate changes: a gain linear in the step and a loss quadratic in it.
void step_row(const HalfRows& from, const HalfRows& to, const HalfRows& data, const float* weight, float* gain,
              float* loss, int width);

/// What is averaged over windows: the region's share, and times it the gain, its square and fourth power, and the loss.
inline constexpr size_t kMeasures = 5;
/// Adds a row of pixels. @param most  gains are cut at plus and minus this
void measure_row(const float* share, const float* gain, const float* loss, float most, float* const* sums, int width);
/// out[x] = factor * (in[2 x] + in[2 x + 1])
void halve_row(const float* in, float factor, float* out, int width);

/// What a step is sure to gain, and its best length, from the means of measures in a window.
/// @param sure    standard errors that are taken off
/// @param pixels  that count as much as the window
/// @return whether any is above 0
bool sure_row(const float* const* means, float sure, float pixels, float* gain, float* share, int width);

/// Where pixels lie between the middles of blocks, linearly.
struct BlockPlaces {
  const int *first, *second;
  const float* share;  ///< of the second
};
/// Takes a proposal where its gain, given at blocks, is above 0 and the largest so far, within a region.
void take_row(const BlockPlaces& at, const float* gains, const float* shares, const float* region, int proposal,
              float* best_gain, float* best_share, int* best_proposal, int width);

/// result += s * (candidate - before), s = spread * share, where that is above 0 and the weight is, too.
/// @param moved  becomes 1 there
void move_row(const float* share, const float* spread, const float* weight, const HalfRows& before,
              const HalfRows& candidate, float* const* result, float* moved, int width);

}  // namespace brume::kernels
