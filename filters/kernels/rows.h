#pragma once

namespace brume::kernels {

// Small loops over rows of floats, compiled for every instruction set and chosen at run time. They are written as plain
// loops, so that the definition and the vector code are the same lines; none adds along x, so every pixel's value is
// the same sum in the same order whatever the width of a vector.

/// out[x] = sum of in[x - radius .. x + radius], clipped to the row.
void box_row(const float* in, float* out, int width, int radius);
/// out[x] = sum over `count` rows.
void sum_rows(const float* const* rows, int count, float* out, int width);
/// out[x] = sum over `count` rows of weight * row.
void weighted_sum_rows(const float* const* rows, const float* weights, int count, float* out, int width);
/// out[x] = median of the nine pixels around (x, 1) of three rows, edges repeated.
void median9_row(const float* above, const float* row, const float* below, float* out, int width);

/// What is kept of a wavelet's detail w whose noise has the variance V.
enum class Shrink {
  kSoft,   ///< |w| - c sqrt(V)
  kBayes,  ///< |w| - c V / sqrt(energy - V)
};
/// sum[x] += what is kept of fine[x] - coarse[x], V being gain * variance[x].
/// @param energy  mean of w^2 around x; read by kBayes alone
void shrink_row(Shrink rule, float strength, float gain, const float* fine, const float* coarse, const float* variance,
                const float* energy, float* sum, int width);

}  // namespace brume::kernels
