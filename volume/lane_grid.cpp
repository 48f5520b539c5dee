#include "volume/lane_grid.h"

#include <algorithm>

namespace brume {

bool LaneGrid::fits(const BrickGrid& grid) {
  const ivec3 n = grid.cells();
  const double cells = static_cast<double>(n.x) * n.y * n.z;
  return !grid.empty() && std::max({n.x, n.y, n.z}) <= 512 && cells <= (1 << 26) &&
         static_cast<double>(grid.brick_count()) * BrickGrid::kBrick < 2147483647.0;
}

LaneGrid::LaneGrid(const BrickGrid& grid, double scale) : nx(grid.cells().x), ny(grid.cells().y), nz(grid.cells().z) {
  const auto at = [this](int x, int y, int z) { return (static_cast<size_t>(x) * ny + y) * nz + z; };
  const size_t count = static_cast<size_t>(nx) * ny * nz;
  majorant.resize(count);
  brick.resize(count);
  constexpr int kFarthest = 64;
  std::vector<uint8_t> distance(count, kFarthest);  // to the nearest cell that is not empty
  for (int x = 0; x < nx; ++x)
    for (int y = 0; y < ny; ++y)
      for (int z = 0; z < nz; ++z) {
        const BrickGrid::Cell& cell = grid.cell({x, y, z});
        if (cell.brick == 0 || !(cell.majorant > 0)) continue;
        if (!values) values = grid.brick(cell) - static_cast<size_t>(cell.brick - 1) * BrickGrid::kBrick;
        const size_t i = at(x, y, z);
        majorant[i] = static_cast<float>(cell.majorant * scale);
        brick[i] = static_cast<int32_t>((cell.brick - 1) * BrickGrid::kBrick);
        distance[i] = 0;
      }
  // Chebyshev distances in two sweeps over the 26 neighbours: 13 before, 13 after.
  const auto sweep = [&](int sign) {
    for (int ix = 0; ix < nx; ++ix)
      for (int iy = 0; iy < ny; ++iy)
        for (int iz = 0; iz < nz; ++iz) {
          const int x = sign > 0 ? ix : nx - 1 - ix, y = sign > 0 ? iy : ny - 1 - iy, z = sign > 0 ? iz : nz - 1 - iz;
          uint8_t& own = distance[at(x, y, z)];
          for (int k = 0; k < 13 && own > 1; ++k) {
            const int qx = x + sign * (k / 9 - 1), qy = y + sign * (k / 3 % 3 - 1), qz = z + sign * (k % 3 - 1);
            if (qx < 0 || qy < 0 || qz < 0 || qx >= nx || qy >= ny || qz >= nz) continue;
            own = std::min<uint8_t>(own, static_cast<uint8_t>(distance[at(qx, qy, qz)] + 1));
          }
        }
  };
  sweep(1), sweep(-1);
  for (size_t i = 0; i < count; ++i)
    if (distance[i] > 0) majorant[i] = -static_cast<float>(distance[i]);
}

}  // namespace brume
