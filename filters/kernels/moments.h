#pragma once
#include <cstddef>

namespace brume::kernels {

// Products of columns that lie side by side: `stride` floats per pixel, a multiple of 16, of which the first `columns`
// explain and those behind, up to `columns + targets`, are explained.

/// Floats that the products of every column with itself, the later columns and the targets take: row i begins at the
/// vector of 16 that holds column i, and rows come in groups of four.
size_t product_floats(size_t columns, size_t stride);
/// Where the product of columns i <= j lies.
size_t product_index(size_t i, size_t j, size_t stride);

/// Columns as they are packed: scale * (row - offset * first row).
struct ColumnRows {
  const float* const* rows;       ///< of each column, a value for each pixel
  const float *offsets, *scales;  ///< of each column
  size_t columns;                 ///< a multiple of 4
};
/// out[x][k] = factors[x] * column k at pixel x, for `count` pixels.
void pack_columns(const ColumnRows& from, const float* factors, size_t count, float* const* out);
/// out[t][x] = sum over columns of coefficients[t * stride + k] * column k at pixel x, for `count` pixels.
void add_columns_up(const ColumnRows& from, const float* coefficients, size_t stride, size_t targets, size_t count,
                    float* const* out);

/// Sums over a row of weights, and of them times u^2, u v and v^2.
struct WeightedProducts {
  double weights = 0, uu = 0, uv = 0, vv = 0;
};
void add_weighted_products(const float* weights, const float* u, const float* v, size_t count, WeightedProducts& sums);

/// products += sum over `count` pixels of v v^T, the part above the diagonal.
/// @param vectors  `count` times `stride`
void add_products(const float* vectors, size_t count, size_t stride, size_t columns, float* products);

/// One row of coefficients that a row of pixels reads, and where.
struct CoefficientRow {
  const float* coefficients;  ///< per node `node` floats, `stride` of them for each target
  const int* nodes;           ///< per pixel, three: which
  const float* weights;       ///< per pixel, three: and how much
  size_t node, targets, stride;
  size_t vector, used;  ///< floats from pixel to pixel, and how many of them count, a multiple of 16
};

/// out[t][x] = sum over the three nodes of weight * (coefficients of t . vector of x).
void predict_row(const float* vectors, size_t width, const CoefficientRow& row, float* const* out);

}  // namespace brume::kernels
