#include "volume/lane_grid.h"

#include <algorithm>

#include "base/parallel_for.h"

namespace brume {
namespace {

constexpr uint8_t kFarthest = 64;

// From zeros at the places that count and kFarthest elsewhere to Chebyshev distances, in two sweeps over the 26
// neighbours: 13 before, 13 after.
void spread_distances(uint8_t* distance, const ivec3& n) {
  const auto at = [&](int x, int y, int z) { return (static_cast<size_t>(x) * n.y + y) * n.z + z; };
  for (const int sign : {1, -1})
    for (int ix = 0; ix < n.x; ++ix)
      for (int iy = 0; iy < n.y; ++iy)
        for (int iz = 0; iz < n.z; ++iz) {
          const int x = sign > 0 ? ix : n.x - 1 - ix, y = sign > 0 ? iy : n.y - 1 - iy,
                    z = sign > 0 ? iz : n.z - 1 - iz;
          uint8_t& own = distance[at(x, y, z)];
          for (int k = 0; k < 13 && own > 1; ++k) {
            const int qx = x + sign * (k / 9 - 1), qy = y + sign * (k / 3 % 3 - 1), qz = z + sign * (k % 3 - 1);
            if (qx < 0 || qy < 0 || qz < 0 || qx >= n.x || qy >= n.y || qz >= n.z) continue;
            own = std::min<uint8_t>(own, static_cast<uint8_t>(distance[at(qx, qy, qz)] + 1));
          }
        }
}

}  // namespace

bool LaneGrid::fits(const BrickGrid& grid) {
  const ivec3 n = grid.cells();
  const double cells = static_cast<double>(n.x) * n.y * n.z;
  return !grid.empty() && std::max({n.x, n.y, n.z}) * grid.cell_size() <= 4096 && cells <= (1 << 26) &&
         static_cast<double>(grid.brick_count() * grid.brick_values()) < 2147483647.0;
}

LaneGrid::LaneGrid(const BrickGrid& grid, double scale)
    : nx(grid.cells().x), ny(grid.cells().y), nz(grid.cells().z), cell_size(grid.cell_size()) {
  const auto at = [this](int x, int y, int z) { return (static_cast<size_t>(x) * ny + y) * nz + z; };
  const size_t count = static_cast<size_t>(nx) * ny * nz;
  majorant.resize(count);
  brick.resize(count);
  std::vector<uint8_t> distance(count, kFarthest);  // to the nearest cell that is not empty
  for (int x = 0; x < nx; ++x)
    for (int y = 0; y < ny; ++y)
      for (int z = 0; z < nz; ++z) {
        const BrickGrid::Cell& cell = grid.cell({x, y, z});
        if (cell.brick == 0 || !(cell.majorant > 0)) continue;
        if (!values) values = grid.brick(cell) - (cell.brick - 1) * grid.brick_values();
        const size_t i = at(x, y, z);
        majorant[i] = static_cast<float>(cell.majorant * scale);
        brick[i] = static_cast<int32_t>((cell.brick - 1) * grid.brick_values());
        distance[i] = 0;
      }
  spread_distances(distance.data(), {nx, ny, nz});
  for (size_t i = 0; i < count; ++i)
    if (distance[i] > 0) majorant[i] = -static_cast<float>(distance[i]);
}

void LaneGrid::find_surface(const BrickGrid& grid, float density, const Task& task) {
  surface_density = density;
  const int stored = grid.stored(), X = stored * stored;
  const size_t voxels = static_cast<size_t>(cell_size) * cell_size * cell_size;
  distances.assign(grid.brick_count() * voxels + sizeof(uint32_t), 0);  // read by words
  parallel_for(static_cast<int>(grid.brick_count()), {task.threads, {}, task.cancel}, [&](int k) {
    const float* const v = values + static_cast<size_t>(k) * grid.brick_values();
    uint8_t* const distance = distances.data() + static_cast<size_t>(k) * voxels;
    size_t i = 0;
    for (int x = 0; x < cell_size; ++x)
      for (int y = 0; y < cell_size; ++y)
        for (int z = 0; z < cell_size; ++z, ++i) {
          const float* const p = v + x * X + y * stored + z;
          const auto edge = [&](int at) { return std::max(p[at], p[at + 1]); };
          distance[i] = std::max({edge(0), edge(stored), edge(X), edge(X + stored)}) >= density ? 0 : kFarthest;
        }
    spread_distances(distance, ivec3(cell_size));
  });
  distances_of_cell.resize(brick.size());
  for (size_t i = 0; i < brick.size(); ++i)
    distances_of_cell[i] = static_cast<int32_t>(static_cast<size_t>(brick[i]) / grid.brick_values() * voxels);
}

}  // namespace brume
