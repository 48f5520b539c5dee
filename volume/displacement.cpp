#include "volume/displacement.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

/// Bounds a density over all that a motion between two times can bring to each place: each cell's velocities span a box
/// of displacements, and the densest cell that it can reach back to counts.
BrickGrid envelope_of(const VectorBricks& field, const VoxelBox& box, const BrickGrid& bricks, double open_time,
                      double close_time, const Task& task) {
  std::vector<ivec3> blocks;
  const ivec3 last = box.hi >> 3;
  for (int x = box.lo.x >> 3; x <= last.x; ++x)
    for (int y = box.lo.y >> 3; y <= last.y; ++y)
      for (int z = box.lo.z >> 3; z <= last.z; ++z) blocks.emplace_back(8 * ivec3(x, y, z));
  const ivec3 first = bricks.origin() >> 3;
  const auto cell_of = [](const dvec3& p) { return ivec3(glm::clamp(p, -1e9, 1e9)) >> 3; };
  constexpr double kLevels = 16;  // per octave: rounded up, so that cells share their storage
  return BrickGrid::build(
      box, blocks,
      [&](const ivec3& lo, float* values) {
        dvec3 lowest(1e300), highest(-1e300);
        for (int a = 0; a < 3; ++a) {
          const BrickGrid& part = field.parts[static_cast<size_t>(a)];
          double low = 0, high = 0;
          if (!part.empty()) {
            const BrickGrid::Cell& cell = part.cell((lo - part.origin()) >> 3);
            if (cell.brick) {
              const auto [l, h] = std::minmax_element(part.brick(cell), part.brick(cell) + BrickGrid::kBrick);
              low = *l;
              high = *h;
            }
          }
          for (const double v : {low, high})
            for (const double t : {open_time, close_time})
              lowest[a] = std::min(lowest[a], -v * t), highest[a] = std::max(highest[a], -v * t);
        }
        const ivec3 from_cell = cell_of(glm::floor(dvec3(lo) + lowest)) - first;
        const ivec3 to_cell = cell_of(glm::ceil(dvec3(lo + 8) + highest)) - first;
        float bound = 0;
        for (int x = std::max(0, from_cell.x); x <= std::min(to_cell.x, bricks.cells().x - 1); ++x)
          for (int y = std::max(0, from_cell.y); y <= std::min(to_cell.y, bricks.cells().y - 1); ++y)
            for (int z = std::max(0, from_cell.z); z <= std::min(to_cell.z, bricks.cells().z - 1); ++z)
              bound = std::max(bound, bricks.cell({x, y, z}).majorant);
        if (bound > 0)
          bound = std::max(bound, static_cast<float>(std::exp2(std::ceil(std::log2(bound) * kLevels) / kLevels)));
        std::fill(values, values + BrickGrid::kBrick, bound);
      },
      task);
}

}  // namespace

Displacement displacement_over(VectorBricks velocity, const VoxelBox& box, const BrickGrid& density, double open,
                               double close, const Task& task) {
  Displacement result;
  result.field = std::move(velocity);
  result.envelope = envelope_of(result.field, box, density, open, close, task);
  result.origin_shift = dvec3(density.origin() - result.envelope.origin());
  result.open = open;
  result.close = close;
  return result;
}

}  // namespace brume
