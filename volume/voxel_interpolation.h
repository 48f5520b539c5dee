#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "volume/medium.h"
#include "volume/voxel_reader.h"

namespace brume {

/// Looks up a displacement between voxels, by index coordinates: look-ups that follow one another lie in one cell.
class VectorReader {
 public:
  explicit VectorReader(const Displacement& of) : field_(&of.field), origin_(of.envelope.origin()) {}

  dvec3 operator()(const dvec3& at) {
    const dvec3 local = at - origin_;
    constexpr double kFar = 1 << 28;
    if (!(max_component(glm::abs(local)) < kFar)) return dvec3(0);
    const ivec3 voxel(glm::floor(local)), cell = voxel >> 3;
    if (cell != cell_) find(cell);
    const dvec3 f = local - dvec3(voxel);
    const ivec3 i = voxel & (BrickGrid::kCell - 1);
    const int first = (i.x * BrickGrid::kStored + i.y) * BrickGrid::kStored + i.z;
    const double x1 = f.x, x0 = 1 - x1, y1 = f.y, y0 = 1 - y1, z1 = f.z, z0 = 1 - z1;
    const std::array<double, 4> w = {x0 * y0, x0 * y1, x1 * y0, x1 * y1};
    constexpr std::array<int, 4> kRows = {0, BrickGrid::kStored, BrickGrid::kStored * BrickGrid::kStored,
                                          BrickGrid::kStored * BrickGrid::kStored + BrickGrid::kStored};
    dvec3 sum(0);
    for (int a = 0; a < 3; ++a) {
      const float* const brick = bricks_[static_cast<size_t>(a)];
      if (!brick) continue;
      for (size_t k = 0; k < 4; ++k) {
        const float* const row = brick + first + kRows[k];
        sum[a] += w[k] * (z0 * static_cast<double>(row[0]) + z1 * static_cast<double>(row[1]));
      }
    }
    return sum;
  }

 private:
  void find(const ivec3& cell) {
    cell_ = cell;
    for (size_t a = 0; a < 3; ++a) {
      const BrickGrid& grid = field_->parts[a];
      const bool within = !grid.empty() && glm::all(glm::greaterThanEqual(cell, ivec3(0))) &&
                          glm::all(glm::lessThan(cell, grid.cells()));
      const BrickGrid::Cell* const found = within ? &grid.cell(cell) : nullptr;
      bricks_[a] = found && found->brick ? grid.brick(*found) : nullptr;
    }
  }
  const VectorBricks* field_;
  dvec3 origin_;  // of all its parts
  ivec3 cell_{std::numeric_limits<int>::min()};
  std::array<const float*, 3> bricks_{};
};

/// A value between voxels: cubic (Catmull and Rom), but never beyond the eight voxels around, so that nothing rings.
class CubicReader {
 public:
  explicit CubicReader(const BrickGrid& grid) : at_(grid) {}

  double operator()(const dvec3& p) {
    constexpr double kFar = 1 << 28;
    if (!(max_component(glm::abs(p)) < kFar)) return 0;
    const ivec3 base(glm::floor(p));
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (int k = 1; k <= 2; ++k)
      for (int j = 1; j <= 2; ++j) {
        const std::array<double, 4> row = row_of(base + ivec3(k, j, 0) - 1);
        low = std::min({low, row[1], row[2]}), high = std::max({high, row[1], row[2]});
      }
    if (low == high) return low;
    const std::array<double, 4> wx = of(p.x - base.x), wy = of(p.y - base.y), wz = of(p.z - base.z);
    double sum = 0;
    for (int x = 0; x < 4; ++x)
      for (int y = 0; y < 4; ++y) {
        const std::array<double, 4> row = row_of(base + ivec3(x, y, 0) - 1);
        sum += wx[static_cast<size_t>(x)] * wy[static_cast<size_t>(y)] *
               (wz[0] * row[0] + wz[1] * row[1] + wz[2] * row[2] + wz[3] * row[3]);
      }
    return std::clamp(sum, low, high);
  }

 private:
  /// The voxel v and the three after it along z.
  std::array<double, 4> row_of(const ivec3& v) {
    std::array<double, 4> row{};
    if (((v.z - at_.grid().origin().z) & (BrickGrid::kCell - 1)) + 3 <=
        BrickGrid::kCell) {  // of one brick, its apron included
      if (const float* const stored = at_.row(v)) std::copy_n(stored, 4, row.begin());
      return row;
    }
    for (int z = 0; z < 4; ++z) row[static_cast<size_t>(z)] = static_cast<double>(at_(v + ivec3(0, 0, z)));
    return row;
  }
  static std::array<double, 4> of(double f) {
    const double f2 = f * f, f3 = f2 * f;
    return {-0.5 * f + f2 - 0.5 * f3, 1 - 2.5 * f2 + 1.5 * f3, 0.5 * f + 2 * f2 - 1.5 * f3, -0.5 * f2 + 0.5 * f3};
  }
  VoxelReader at_;
};

}  // namespace brume
