#pragma once
#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "volume/voxel_reader.h"

// Values of whole cells and bricks, by index coordinates that may lie outside of the grid.

namespace brume {

/// The voxels of a cube of N along each axis, index coordinates lo .. lo + N - 1; z fastest.
template <int N>
void read_cube(const BrickGrid& grid, const ivec3& lo, float* values) {
  VoxelReader at(grid);
  for (int x = 0; x < N; ++x)
    for (int y = 0; y < N; ++y)
      for (int z = 0; z < N;) {
        const ivec3 v = lo + ivec3(x, y, z);
        const int in_cell = std::min(N - z, BrickGrid::kCell - ((v.z - grid.origin().z) & (BrickGrid::kCell - 1)));
        if (const float* const row = at.row(v))
          std::copy_n(row, in_cell, values);
        else
          std::fill_n(values, in_cell, 0.0f);
        values += in_cell;
        z += in_cell;
      }
}

/// The value of a brick at a multiple of 8 that holds but one.
inline std::optional<float> constant_in(const BrickGrid& grid, const ivec3& lo) {
  if (grid.empty()) return 0.0f;
  const ivec3 cell = (lo - grid.origin()) >> 3;
  if (glm::any(glm::lessThan(cell, ivec3(0))) || glm::any(glm::greaterThanEqual(cell, grid.cells()))) return 0.0f;
  const BrickGrid::Cell& found = grid.cell(cell);
  if (!found.brick) return 0.0f;
  const float* const values = grid.brick(found);
  if (!std::all_of(values, values + BrickGrid::kBrick, [&](float v) { return v == values[0]; })) return {};
  return values[0];
}

/// The least and the greatest value of each cell; those of a shared brick are looked for once.
class CellRanges {
 public:
  explicit CellRanges(const BrickGrid& grid) : grid_(&grid), ranges_(grid.brick_count() + 1) {
    std::vector<uint8_t> known(ranges_.size());
    grid.each_distinct_cell([&](const BrickGrid::Cell& cell, uint64_t) {
      if (known[cell.brick]) return;
      known[cell.brick] = 1;
      const auto [low, high] = std::minmax_element(grid.brick(cell), grid.brick(cell) + BrickGrid::kBrick);
      ranges_[cell.brick] = {*low, *high};
    });
  }
  /// @param c  index coordinates of the cell's first voxel / 8; it may lie outside
  std::pair<float, float> in(const ivec3& c) const {
    if (grid_->empty()) return {};
    const ivec3 local = c - (grid_->origin() >> 3);
    if (glm::any(glm::lessThan(local, ivec3(0))) || glm::any(glm::greaterThanEqual(local, grid_->cells()))) return {};
    return ranges_[grid_->cell(local).brick];
  }

 private:
  const BrickGrid* grid_;
  std::vector<std::pair<float, float>> ranges_;  // by the number of a cell's brick; {0, 0} for none
};

}  // namespace brume
