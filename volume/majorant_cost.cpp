#include "volume/majorant_cost.h"

#include <algorithm>
#include <limits>

namespace brume {
namespace {

template <class Visit>
void each_cell(const BrickGrid& grid, const Visit& visit) {
  const ivec3 cells = grid.cells();
  for (int x = 0; x < cells.x; ++x)
    for (int y = 0; y < cells.y; ++y)
      for (int z = 0; z < cells.z; ++z)
        if (const BrickGrid::Cell& cell = grid.cell({x, y, z}); cell.majorant > 0) visit(cell);
}

}  // namespace

double most_tentative_collisions(const Medium& medium) {
  constexpr double kUnremarkable = 1e3;  // cells below are not looked into
  if (medium.empty() || medium.homogeneous()) return 0;
  const BrickGrid& grid = medium.walked();
  const double per_density =
      medium.extinction_per_density() * medium.majorant_scale() * medium.voxel_size() * grid.cell_size();
  double most = 0;
  each_cell(grid, [&](const BrickGrid::Cell& cell) {
    const double majorant = medium.global_majorant() ? grid.maximum() : cell.majorant;
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
  const size_t step = std::max<size_t>(1, grid.brick_count() * static_cast<size_t>(size) * size * size / kMost);
  std::vector<float> values;
  size_t number = 0;
  each_cell(grid, [&](const BrickGrid::Cell& cell) {
    // Without the far faces, which are those of the next cells.
    for (int x = 0; x < size; ++x)
      for (int y = 0; y < size; ++y)
        for (int z = 0; z < size; ++z)
          if (number++ % step == 0)
            if (const float v = grid.brick(cell)[(x * stored + y) * stored + z]; v > 0) values.push_back(v);
  });
  std::vector<double> quantiles;
  if (values.empty()) return quantiles;
  std::sort(values.begin(), values.end());
  for (const double share : shares)
    quantiles.push_back(values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))]);
  return quantiles;
}

}  // namespace brume
