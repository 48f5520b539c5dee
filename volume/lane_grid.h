#pragma once
#include <cstdint>
#include <vector>

#include "volume/brick_grid.h"

namespace brume {

/// A BrickGrid's cells laid out flat, for rays that are walked in SIMD lanes: one gather tells how far a cell can be
/// crossed, a second one finds its values.
struct LaneGrid {
  LaneGrid() = default;
  /// Whether 32-bit offsets and single-precision local coordinates are enough for a grid: at most 4096 voxels a side
  /// (positions known to 1/4096 of a voxel), 2^26 cells, 2^31 values.
  static bool fits(const BrickGrid& grid);
  /// @param scale  factor on all majorants, at least 1: a looser bound changes no expectation
  explicit LaneGrid(const BrickGrid& grid, double scale = 1.0);

  size_t bytes() const { return majorant.size() * sizeof(float) + brick.size() * sizeof(int32_t); }

  int nx = 0, ny = 0, nz = 0;
  /// x slowest, z fastest. Positive: bound of the density in the cell. Negative, -(r + 1): the cell and all others
  /// within r cells of it (Chebyshev distance) are empty, and can be crossed in one step.
  std::vector<float> majorant;
  std::vector<int32_t> brick;  ///< where the cell's 9 x 9 x 9 values begin in `values`
  const float* values = nullptr;
};

}  // namespace brume
