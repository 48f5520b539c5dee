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

  /// Finds how far each voxel is from those that can reach a density, so that a walk to its surface interpolates
  /// nowhere else and takes long steps.
  void find_surface(const BrickGrid& grid, float density, const Task& task = {});

  size_t bytes() const {
    return majorant.size() * sizeof(float) + (brick.size() + distances_of_cell.size()) * sizeof(int32_t) +
           distances.size();
  }

  int nx = 0, ny = 0, nz = 0;
  int cell_size = 0;  ///< in voxels
  /// x slowest, z fastest. Positive: bound of the density in the cell. Negative, -(r + 1): the cell and all others
  /// within r cells of it (Chebyshev distance) are empty, and can be crossed in one step.
  std::vector<float> majorant;
  std::vector<int32_t> brick;  ///< where the cell's values begin in `values`
  const float* values = nullptr;
  /// One for each voxel of a brick, the cubes between eight values, x slowest: its distance (Chebyshev) from the
  /// nearest one in the brick of whose values one reaches surface_density.
  std::vector<uint8_t> distances;
  std::vector<int32_t> distances_of_cell;  ///< where each cell's begin
  float surface_density = 0;
};

}  // namespace brume
