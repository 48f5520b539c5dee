#include "volume/majorant_cost.h"

#include <algorithm>
#include <limits>

namespace brume {

double most_tentative_collisions(const Medium& medium) {
  constexpr double kUnremarkable = 1e3;  // cells below are not looked into
  if (medium.empty() || medium.homogeneous()) return 0;
  const BrickGrid& grid = medium.walked();
  const double per_density =
      medium.extinction_per_density() * medium.majorant_scale() * medium.voxel_size() * grid.cell_size();
  const double factor = medium.majorant_factor();
  double most = 0;
  grid.each_distinct_cell([&](const BrickGrid::Cell& cell, uint64_t) {
    const double majorant = factor * (medium.global_majorant() ? grid.maximum() : cell.majorant);
    double collisions = per_density * majorant;
    if (collisions > std::max(most, kUnremarkable) && cell.brick != 0) {
      const float* const values = grid.brick(cell);
      const double least = *std::min_element(values, values + grid.brick_values());
      if (least > 0) collisions = std::min(collisions, majorant / least);
    }
    most = std::max(most, collisions);
  });
  return most;
}

std::vector<double> density_quantiles(const BrickGrid& grid, const std::vector<double>& shares) {
  constexpr size_t kMost = 1 << 20;
  const int size = grid.cell_size(), stored = grid.stored();
  size_t distinct = 0;
  grid.each_distinct_cell([&](const BrickGrid::Cell&, uint64_t) { ++distinct; });
  const size_t step = std::max<size_t>(1, distinct * static_cast<size_t>(size) * size * size / kMost);
  std::vector<std::pair<float, uint64_t>> values;  // with how many voxels hold them
  uint64_t total = 0;
  size_t number = 0;
  grid.each_distinct_cell([&](const BrickGrid::Cell& cell, uint64_t cells) {
    // Without the far faces, which are those of the next cells.
    for (int x = 0; x < size; ++x)
      for (int y = 0; y < size; ++y)
        for (int z = 0; z < size; ++z)
          if (number++ % step == 0)
            if (const float v = grid.brick(cell)[(x * stored + y) * stored + z]; v > 0) {
              values.emplace_back(v, cells);
              total += cells;
            }
  });
  std::vector<double> quantiles;
  if (values.empty()) return quantiles;
  std::sort(values.begin(), values.end());
  for (const double share : shares) {
    const double wanted = share * static_cast<double>(total - 1);
    uint64_t passed = 0;
    for (const auto& [value, voxels] : values) {
      passed += voxels;
      if (static_cast<double>(passed) > wanted) {
        quantiles.push_back(static_cast<double>(value));
        break;
      }
    }
  }
  return quantiles;
}

}  // namespace brume
