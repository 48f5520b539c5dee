#pragma once
#include <span>

#include "image/plane.h"

namespace brume::kernels {

/// Solves `count` symmetric systems at once, system x being element x of every row: A (n x n, the upper triangle row by
/// row, each entry a row of `stride` floats) times X (n x m) = B, which X replaces; A is destroyed. Each diagonal entry
/// grows by ridge * (itself) + floor * A_00 first, so that a column of zeros has the solution 0.
void solve_rows(float* a, float* b, int n, int m, int count, size_t stride, float ridge, float floor);

/// Normal equations that solve_together() solves side by side.
inline constexpr size_t kTogether = 8;
/// Solves A b = t for kTogether symmetric A, by elimination without square roots, A = U^T D U. From column `free` on
/// diagonals grow by `ridge` of what the columns before leave of them; a column that those before explain to all but
/// `dependent` of itself gets 0.
/// @param a  the upper triangle, row by row, of kTogether numbers each; becomes U but for its diagonal
/// @param b  n times m such; becomes the solution
/// @param variance  room for n such
void solve_together(double* a, double* b, double* variance, size_t n, size_t m, size_t free, const double* ridge,
                    double dependent);

/// Place of entry (row <= column) of the upper triangle.
inline int triangle(int row, int column, int n) {
  return row * n - row * (row - 1) / 2 + column - row;
}

/// Pixels are taken in blocks of at most this many: rows of sums are so aligned, and their lengths multiples of it.
constexpr size_t kRegressionLanes = 16;
/// Longest side of a window [px].
constexpr int kRegressionSide = 41;

/// A run of pixels p in one row and a row of their neighbours q, in copies of the block around them: features, then
/// values, plane by plane. Where q is outside of the image the weight is 0, and the copy is finite.
struct RegressionRow {
  const float* here;    ///< features and values of the first p
  const float* there;   ///< of the q left of it by `radius`; may be in another frame
  size_t pitch, plane;  ///< from row to row and from plane to plane [floats]
  int features, values, count, radius;
  size_t stride;  ///< of the rows of a, b and the weights [floats]
};

/// Adds the terms of the 2 * radius + 1 neighbours in the row dy to the normal equations of `count` pixels: regressors
/// 1, dx / radius, dy / radius, f_k(q) - f_k(p); values v_c(q) - v_c(p).
/// @param weights  offset by offset, `weight_step` floats apart
void accumulate_normal(const RegressionRow& row, const float* weights, size_t weight_step, int dy, float* scratch,
                       float* a, float* b);
/// Floats of scratch that accumulate_normal needs, aligned as vectors are.
size_t normal_scratch(int features, int values, int radius);

/// What predictions are made from and added to.
struct ScatterRow {
  RegressionRow row;
  const float* weights;
  size_t weight_row;                             ///< from the weights of one dy to those of the next [floats]
  const float* b;                                ///< the solution of the normal equations
  std::span<const float*const> lowest, highest;  ///< bounds of every pixel's predictions
  float* sums;  ///< of values, then of weights: laid out as the copies, at the neighbour left by `radius`
};
/// Adds each pixel's predictions for its neighbours (dx, dy) and, where `rows` is 2, (dx, dy + 1), times the weights,
/// to the neighbours' sums; the weights themselves to the last one.
void scatter_prediction(const ScatterRow& row, int dx, int dy, int rows);

}  // namespace brume::kernels
