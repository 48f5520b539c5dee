#include "volume/lane_grid.h"

#include <algorithm>
#include <bit>
#include <limits>

#include "base/parallel_for.h"

namespace brume {
namespace {

// A set of voxels of a brick: for each row along z, of x and y, a bit for each of its voxels.
using Rows = std::vector<uint64_t>;

constexpr double kMostCells = 1 << 26;

// The voxels with at least one of their eight values at or above a density; n voxels and n + 1 values along the brick.
void find_reaching(const float* values, int n, float density, Rows& rows) {
  const int stored = n + 1;
  Rows at_least(static_cast<size_t>(stored) * stored);
  for (uint64_t& row : at_least) {
    row = 0;
    for (int z = 0; z < stored; ++z) row |= static_cast<uint64_t>(*values++ >= density) << z;
    row |= row >> 1;
  }
  for (int x = 0; x < n; ++x)
    for (int y = 0; y < n; ++y) {
      const uint64_t* const r = at_least.data() + x * stored + y;
      rows[x * n + y] = (r[0] | r[1] | r[stored] | r[stored + 1]) & ((uint64_t{1} << n) - 1);
    }
}

// Chebyshev distances of all voxels of a brick from a set, by dilating the set by one voxel until it fills the brick; n
// where the set is empty, as it can be under loose majorants.
void measure_distances(Rows& rows, int n, uint8_t* distance) {
  const uint64_t full = (uint64_t{1} << n) - 1;
  Rows along(rows.size()), grown(rows.size());
  const auto reached = [&](int at, uint64_t fresh, int r) {
    for (; fresh; fresh &= fresh - 1) distance[at * n + std::countr_zero(fresh)] = static_cast<uint8_t>(r);
  };
  std::fill_n(distance, static_cast<size_t>(n) * n * n, static_cast<uint8_t>(n));
  for (int at = 0; at < n * n; ++at) reached(at, rows[at], 0);
  for (int r = 1; r < n; ++r) {
    bool all = true;
    for (int x = 0; x < n; ++x)
      for (int y = 0; y < n; ++y) {
        const auto z_grown = [&](int at) { return rows[at] | rows[at] << 1 | rows[at] >> 1; };
        const int at = x * n + y;
        along[at] = z_grown(at) | (y > 0 ? z_grown(at - 1) : 0) | (y + 1 < n ? z_grown(at + 1) : 0);
      }
    for (int x = 0; x < n; ++x)
      for (int y = 0; y < n; ++y) {
        const int at = x * n + y;
        grown[at] = (along[at] | (x > 0 ? along[at - n] : 0) | (x + 1 < n ? along[at + n] : 0)) & full;
        reached(at, grown[at] & ~rows[at], r);
        all &= grown[at] == full;
      }
    rows.swap(grown);
    if (all) break;
  }
}

// For every empty cell the side of the largest empty cube that has the cell at its corner and extends into an octant,
// at most OctantSkip::kFarthest, by dynamic programming from the octant's far end. Outside the grid everything is
// empty.
std::vector<uint16_t> measure_empty_cubes(const std::vector<uint8_t>& empty, const ivec3& n, int octant) {
  std::vector<uint16_t> clear(empty.size());
  const auto at = [&](int x, int y, int z) { return (static_cast<size_t>(x) * n.y + y) * n.z + z; };
  const ivec3 step(octant & 4 ? -1 : 1, octant & 2 ? -1 : 1, octant & 1 ? -1 : 1);
  const auto first = [&](int a) { return step[a] > 0 ? n[a] - 1 : 0; };
  const auto inside = [&](int a, int i) { return i >= 0 && i < n[a]; };
  for (int x = first(0); inside(0, x); x -= step.x)
    for (int y = first(1); inside(1, y); y -= step.y)
      for (int z = first(2); inside(2, z); z -= step.z) {
        uint16_t& own = clear[at(x, y, z)];
        own = 0;
        if (!empty[at(x, y, z)]) continue;
        uint16_t shortest = OctantSkip::kFarthest - 1;
        for (int k = 1; k < 8; ++k) {
          const int qx = x + (k & 4 ? step.x : 0), qy = y + (k & 2 ? step.y : 0), qz = z + (k & 1 ? step.z : 0);
          if (inside(0, qx) && inside(1, qy) && inside(2, qz)) shortest = std::min(shortest, clear[at(qx, qy, qz)]);
        }
        own = static_cast<uint16_t>(shortest + 1);
      }
  return clear;
}

// Gives the empty cells their OctantSkip.
void mark_empty(LaneGrid& grid, const std::vector<uint8_t>& empty, const Task& task) {
  std::array<std::vector<uint16_t>, 8> clear;
  const Task silent{task.threads, {}, task.cancel};
  parallel_for(8, silent, [&](int octant) {
    clear[static_cast<size_t>(octant)] = measure_empty_cubes(empty, {grid.nx, grid.ny, grid.nz}, octant);
  });
  const auto slab = static_cast<size_t>(grid.ny) * grid.nz;
  parallel_for(grid.nx, silent, [&](int x) {
    for (size_t i = static_cast<size_t>(x) * slab; i < (static_cast<size_t>(x) + 1) * slab; ++i) {
      if (!empty[i]) continue;
      std::array<uint16_t, 8> of_cell;
      for (size_t octant = 0; octant < 8; ++octant) of_cell[octant] = clear[octant][i];
      grid.majorant[i] = std::bit_cast<float>(OctantSkip::pack(of_cell));
    }
  });
}

/// Of all bricks, one after the other; null without any.
const float* values_of(const BrickGrid& grid) {
  BrickGrid::Cell first;
  first.brick = 1;
  return grid.brick_count() > 0 ? grid.brick(first) : nullptr;
}

}  // namespace

bool LaneGrid::fits(const BrickGrid& grid) {
  const ivec3 n = grid.cells();
  const double cells = static_cast<double>(n.x) * n.y * n.z;
  return !grid.empty() && std::max({n.x, n.y, n.z}) * grid.cell_size() <= 4096 && cells <= kMostCells &&
         static_cast<double>(grid.brick_count() * grid.brick_values()) < 2147483647.0;
}

bool LaneGrid::resolves(const BrickGrid& grid, double free_path) {
  const ivec3 n = grid.cells();
  return free_path >= 16 * 0x1p-24 * std::max({n.x, n.y, n.z}) * grid.cell_size();
}

LaneGrid::LaneGrid(const BrickGrid& grid, double scale, const Task& task)
    : nx(grid.cells().x), ny(grid.cells().y), nz(grid.cells().z), cell_size(grid.cell_size()) {
  const auto at = [this](int x, int y, int z) { return (static_cast<size_t>(x) * ny + y) * nz + z; };
  const size_t count = static_cast<size_t>(nx) * ny * nz;
  majorant.resize(count);
  brick.assign(count, -1);
  values = values_of(grid);
  std::vector<uint8_t> empty(count, 1);
  for (int x = 0; x < nx; ++x)
    for (int y = 0; y < ny; ++y)
      for (int z = 0; z < nz; ++z) {
        const BrickGrid::Cell& cell = grid.cell({x, y, z});
        if (cell.brick == 0 || !(cell.majorant > 0)) continue;
        const size_t i = at(x, y, z);
        majorant[i] = static_cast<float>(cell.majorant * scale);
        brick[i] = static_cast<int32_t>((cell.brick - 1) * grid.brick_values());
        empty[i] = 0;
      }
  mark_empty(*this, empty, task);
}

LaneGrid LaneGrid::halved(const BrickGrid& grid, double scale, const Task& task) {
  LaneGrid result;
  const ivec3 whole = grid.cells(), n = 2 * whole;
  if (grid.cell_size() < 4 || static_cast<double>(n.x) * n.y * n.z > kMostCells) return result;
  result.nx = n.x, result.ny = n.y, result.nz = n.z;
  result.cell_size = grid.cell_size() / 2;
  const size_t count = static_cast<size_t>(n.x) * n.y * n.z;
  result.majorant.resize(count);
  result.brick.assign(count, -1);
  std::vector<uint8_t> empty(count, 1);
  result.values = values_of(grid);
  const int side = result.cell_size, row = grid.stored();
  parallel_for(n.x, quiet(task), [&](int x) {
    for (int y = 0; y < n.y; ++y)
      for (int z = 0; z < n.z; ++z) {
        const BrickGrid::Cell& cell = grid.cell({x / 2, y / 2, z / 2});
        if (cell.brick == 0 || !(cell.majorant > 0)) continue;
        const float* const brick = grid.brick(cell);
        const size_t number = (cell.brick - 1) * grid.brick_values();
        const int within = ((x % 2) * row + y % 2) * side * row + z % 2 * side;
        float largest = 0;
        for (int i = 0; i <= side; ++i)
          for (int j = 0; j <= side; ++j)
            for (int k = 0; k <= side; ++k) largest = std::max(largest, brick[within + (i * row + j) * row + k]);
        if (!(largest > 0)) continue;
        const size_t i = (static_cast<size_t>(x) * n.y + y) * n.z + z;
        result.majorant[i] = static_cast<float>(largest * scale);
        result.brick[i] = static_cast<int32_t>(number) + within;
        empty[i] = 0;
      }
  });
  mark_empty(result, empty, task);
  return result;
}

LaneGrid LaneGrid::of_values(const BrickGrid& grid) {
  LaneGrid result;
  if (grid.empty()) return result;
  const ivec3 n = grid.cells();
  result.nx = n.x, result.ny = n.y, result.nz = n.z;
  result.cell_size = grid.cell_size();
  result.values = values_of(grid);
  for (int x = 0; x < n.x; ++x)
    for (int y = 0; y < n.y; ++y)
      for (int z = 0; z < n.z; ++z) {
        const BrickGrid::Cell& cell = grid.cell({x, y, z});
        if (cell.brick == 0) {
          result.brick.push_back(-1);
          continue;
        }
        const size_t offset = (cell.brick - 1) * grid.brick_values();
        result.brick.push_back(static_cast<int32_t>(offset));
      }
  return result;
}

uint32_t OctantSkip::pack(const std::array<uint16_t, 8>& clear) {
  // Of the steps, the one that keeps most of the product of the sides; none longer than the longest side needs.
  const uint32_t longest = *std::max_element(clear.begin(), clear.end());
  uint32_t best = 0;
  double most = -1;
  for (const uint32_t step : {1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 63}) {
    uint32_t word = kEmpty | step << kStepShift;
    double product = 1;
    for (int octant = 0; octant < 8; ++octant) {
      const uint32_t steps = std::min<uint32_t>((clear[octant] - 1u) / step, 7);
      word |= steps << 3 * octant;
      product *= 1.0 + steps * step;
    }
    if (product > most) {
      most = product;
      best = word;
    }
    if (1 + 7 * step >= longest) break;
  }
  return best;
}

LaneGrid::Entry LaneGrid::entry_bound(const RayCone& cone, const Entry& from) const {
  constexpr int kMostCubes = 64;  // in a layer: in wider cones any cube is taken to be there
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const ivec3 n(nx, ny, nz);
  const RayConeLayers cells(cone, n, cell_size), voxels(cone, n * cell_size, 1.0);
  if (!cells.ordered()) return {0, 0};
  const int bits = std::countr_zero(static_cast<unsigned>(cell_size)), mask = cell_size - 1;
  const auto index = [&](const ivec3& c) { return (static_cast<size_t>(c.x) * ny + c.y) * nz + c.z; };
  // Whether a layer holds a cube of a kind, or more cubes than are tested.
  const auto holds = [](const RayConeLayers::Layer& layer, const auto& kind) {
    if (layer.cubes() > kMostCubes) return true;
    for (int x = layer.lo.x; x <= layer.hi.x; ++x)
      for (int y = layer.lo.y; y <= layer.hi.y; ++y)
        for (int z = layer.lo.z; z <= layer.hi.z; ++z)
          if (kind(ivec3(x, y, z))) return true;
    return false;
  };
  const auto holds_medium = [&](const ivec3& c) { return !(majorant[index(c)] < 0); };
  const auto holds_isosurface = [&](const ivec3& c) { return isosurface_cell[index(c)] >= 0; };
  const auto reaches_isosurface = [&](const ivec3& v) {
    const int32_t number = isosurface_cell[index(v >> bits)];
    const auto in_brick = static_cast<size_t>(((v.x & mask) << 2 * bits) + ((v.y & mask) << bits) + (v.z & mask));
    return number >= 0 && distances[(static_cast<size_t>(number) << 3 * bits) + in_brick] == 0;
  };

  Entry m{kNever, kNever};
  int k = from.medium < kNever ? cells.first(from.medium) : -1;
  for (; cells.has(k) && m.medium == kNever; k += cells.step()) {
    const RayConeLayers::Layer layer = cells.layer(k);
    if (holds(layer, holds_medium)) m.medium = std::max(layer.begin, 0.0);
  }
  if (isosurface_cell.empty()) return {m.medium, m.medium};
  const double begin = std::max(m.medium, from.surface);
  for (int v = begin < kNever ? voxels.first(begin) : -1; voxels.has(v);) {
    const int step = voxels.step(), in_cell = step > 0 ? v & mask : mask - (v & mask);
    if (holds(cells.layer(v >> bits), holds_isosurface)) {
      for (int i = in_cell; i < cell_size; ++i, v += step) {
        const RayConeLayers::Layer layer = voxels.layer(v);
        if (!holds(layer, reaches_isosurface)) continue;
        m.surface = std::max(layer.begin, m.medium);
        if (voxels.most_crossed() <= kPacketVoxels) {
          m.axis = voxels.axis();
          m.layer = v;
        }
        return m;
      }
    } else {
      v += step * (cell_size - in_cell);
    }
  }
  return m;
}

void LaneGrid::find_isosurface(const BrickGrid& grid, float density, const Task& task) {
  isosurface_density = density;
  const size_t voxels = static_cast<size_t>(cell_size) * cell_size * cell_size;
  distances.assign(grid.brick_count() * voxels + sizeof(uint32_t), 0);  // read by words
  parallel_for(static_cast<int>(grid.brick_count()), {task.threads, {}, task.cancel}, [&](int k) {
    static thread_local Rows rows;
    rows.resize(static_cast<size_t>(cell_size) * cell_size);
    find_reaching(values + static_cast<size_t>(k) * grid.brick_values(), cell_size, density, rows);
    measure_distances(rows, cell_size, distances.data() + static_cast<size_t>(k) * voxels);
  });
  isosurface_cell.resize(brick.size());
  for (size_t i = 0; i < brick.size(); ++i) {
    const int32_t number = brick[i] / static_cast<int32_t>(grid.brick_values());
    constexpr auto kSingle = static_cast<int32_t>(OctantSkip::kEmpty | 1u << OctantSkip::kStepShift);
    isosurface_cell[i] = majorant[i] < 0         ? std::bit_cast<int32_t>(majorant[i])
                         : majorant[i] < density ? kSingle
                                                 : number;
  }
}

}  // namespace brume
