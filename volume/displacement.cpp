#include "volume/displacement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "volume/cell_values.h"
#include "volume/vdb_io.h"
#include "volume/velocity_extension.h"

namespace brume {
namespace {

/// Bounds a density over all that a motion between two times can bring to each place: each cell's velocities span a box
/// of displacements, and the densest cell that it can reach back to counts.
BrickGrid envelope_of(const VectorBricks& field, const VoxelBox& box, const BrickGrid& bricks, double open_time,
                      double close_time, const Task& task) {
  // Where neither moves anything nor is there anything, nothing can be.
  std::vector<ivec3> blocks;
  const auto add_cells_of = [&](const BrickGrid& grid) {
    grid.each_cell([&](const ivec3& c) { blocks.push_back(grid.origin() + BrickGrid::kCell * c); });
  };
  add_cells_of(bricks);
  for (const BrickGrid& part : field.parts) add_cells_of(part);
  const std::array parts{CellRanges(field.parts[0]), CellRanges(field.parts[1]), CellRanges(field.parts[2])};
  const ivec3 first = bricks.origin() >> 3;
  const auto cell_of = [](const dvec3& p) { return ivec3(glm::clamp(p, -1e9, 1e9)) >> 3; };
  constexpr double kLevels = 16;  // per octave: rounded up, so that cells share their storage
  return BrickGrid::build(
      box, blocks,
      [&](const ivec3& lo, float* values) {
        dvec3 lowest(1e300), highest(-1e300);
        for (int a = 0; a < 3; ++a) {
          const auto [low, high] = parts[static_cast<size_t>(a)].in(lo >> 3);
          for (const double v : {static_cast<double>(low), static_cast<double>(high)})
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

Displacement displacement_over(const StoredVelocity& velocity, const ScalarField& density, const ShutterMotion& motion,
                               std::vector<std::string>& notes, const Task& task) {
  ExtendedVelocity extended = extend_velocity(velocity, density, motion, notes, task);
  Displacement result;
  result.field = std::move(extended.field);
  result.envelope = envelope_of(result.field, extended.box, density.bricks, motion.open, motion.close, task);
  result.origin_shift = dvec3(density.bricks.origin() - result.envelope.origin());
  result.open = motion.open;
  result.close = motion.close;
  return result;
}

}  // namespace brume
