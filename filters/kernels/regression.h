#pragma once
#include <span>

#include "image/plane.h"

namespace brume::kernels {

/// Solves `count` symmetric systems at once, system x being element x of every row: A (n x n, the upper triangle row by
/// row, each entry a row of `stride` floats) times X (n x m) = B, which X replaces; A is destroyed. Each diagonal entry
/// grows by ridge * (itself) + floor * A_00 first, so that a column of zeros has the solution 0.
void solve_rows(float* a, float* b, int n, int m, int count, size_t stride, float ridge, float floor);

/// Place of entry (row <= column) of the upper triangle.
inline int triangle(int row, int column, int n) {
  return row * n - row * (row - 1) / 2 + column - row;
}

/// Adds the terms of `offsets` neighbours (dx0 .. dx0 + offsets - 1, dy) to the normal equations of `count` pixels at
/// (x0, y): regressors 1, dx / radius, dy / radius, f_k(q) - f_k(p); values v_c(q) - v_c(p). All q must lie inside.
/// @param weights  offset by offset, `weight_step` floats apart
struct RegressionRow {
  std::span<const Plane*const> features, values;              ///< of p
  std::span<const Plane*const> features_there, values_there;  ///< of q, which may be in another frame
  int x0, y, count, radius;
  size_t stride;
};
void accumulate_normal(const RegressionRow& row, const float* weights, size_t weight_step, int dx0, int dy, int offsets,
                       float* scratch, float* a, float* b);
/// Floats of scratch that accumulate_normal needs.
size_t normal_scratch(size_t features, size_t values, size_t stride);

/// Adds each pixel's prediction for its neighbour (dx, dy), times the weight, to the neighbour's sums; the weight
/// itself to `total`.
/// @param b  the solution of the normal equations
/// @param lowest, highest  bounds of every pixel's predictions
void scatter_prediction(const RegressionRow& row, const float* weights, int dx, int dy, const float* b,
                        std::span<const Plane> lowest, std::span<const Plane> highest, std::span<Plane* const> sums,
                        Plane& total);

}  // namespace brume::kernels
