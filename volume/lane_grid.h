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

  /// Marks the voxels that can reach a density, so that a walk to its surface interpolates nowhere else.
  void mark_surface(const BrickGrid& grid, float density);

  size_t bytes() const {
    return majorant.size() * sizeof(float) + (brick.size() + marks_of_cell.size()) * sizeof(int32_t) +
           marks.size() * sizeof(uint32_t);
  }

  int nx = 0, ny = 0, nz = 0;
  int cell_size = 0;  ///< in voxels
  /// x slowest, z fastest. Positive: bound of the density in the cell. Negative, -(r + 1): the cell and all others
  /// within r cells of it (Chebyshev distance) are empty, and can be crossed in one step.
  std::vector<float> majorant;
  std::vector<int32_t> brick;  ///< where the cell's values begin in `values`
  const float* values = nullptr;
  /// One bit for each voxel of a brick, the cubes between eight values, x slowest: whether one of the eight reaches the
  /// surface's density.
  std::vector<uint32_t> marks;
  std::vector<int32_t> marks_of_cell;  ///< the first word of each cell's
  float surface_density = 0;
};

}  // namespace brume
