#pragma once
#include <cstddef>
#include <span>

namespace brume::kernels {

/// One component of a sample's record that counts in the distance, and by how much: its difference is multiplied by
/// `scale` before it is squared.
struct ScaledComponent {
  int index;
  float scale;
};

/// Filters up to 16 samples of a pixel over a neighbourhood of samples (random parameter filtering):
/// w_ij = exp(-sum_k (scale_k (x_ik - x_jk))^2), sums over j of w and w * color_j.
/// @param records  `count` of them, `width` floats apart, the pixel's own first; the colour of each at `color`
/// @param own      of the pixel, at most 16
/// @param sums     weight, r, g, b: rows of 16
void filter_samples(const float* records, size_t own, size_t count, size_t width, size_t color,
                    std::span<const ScaledComponent> components, float (*sums)[16]);

/// Sums and sums of squares of the first `columns` numbers of records, less the first record's.
void column_moments(const float* records, size_t count, size_t width, size_t columns, double* sums, double* squares);

/// Bounds of some consecutive numbers of a record.
struct RecordBounds {
  size_t begin, count;
  const float *low, *high;
};
/// Copies records of `length` numbers, each with its colour (three floats) behind, to places `width` apart: the first
/// `always`, of the others those within the bounds. @return how many
size_t collect_records(std::span<const float* const> records, std::span<const float* const> colors, size_t always,
                       size_t length, const RecordBounds& bounds, float* to, size_t width);

}  // namespace brume::kernels
