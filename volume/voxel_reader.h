#pragma once
#include "volume/brick_grid.h"

namespace brume {

/// Reads voxels one after another, by their index coordinates: neighbours lie in one cell.
class VoxelReader {
 public:
  explicit VoxelReader(const BrickGrid& grid) : grid_(&grid) {}

  const BrickGrid& grid() const { return *grid_; }

  float operator()(const ivec3& v) {
    const float* const value = row(v);
    return value ? *value : 0.0f;
  }
  /// The voxel v and those after it along z in its cell; null: they are 0.
  const float* row(const ivec3& v) {
    if (grid_->empty()) return nullptr;
    const ivec3 local = v - grid_->origin(), cell = local >> 3;
    if (cell != cell_) {
      cell_ = cell;
      const bool inside =
          glm::all(glm::greaterThanEqual(cell, ivec3(0))) && glm::all(glm::lessThan(cell, grid_->cells()));
      const BrickGrid::Cell* const found = inside ? &grid_->cell(cell) : nullptr;
      brick_ = found && found->brick ? grid_->brick(*found) : nullptr;
    }
    if (!brick_) return nullptr;
    const ivec3 i = local & (BrickGrid::kCell - 1);
    return brick_ + (i.x * BrickGrid::kStored + i.y) * BrickGrid::kStored + i.z;
  }

 private:
  const BrickGrid* grid_;
  ivec3 cell_{-1};
  const float* brick_ = nullptr;
};

}  // namespace brume
