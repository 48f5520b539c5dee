#include "render/transport/lane_detail.h"

#include <algorithm>

#include "volume/medium.h"

namespace brume {

bool velocity_fits(const Detail& detail) {
  if (!detail.velocity()) return true;
  const auto& parts = detail.velocity()->field.parts;
  return std::all_of(parts.begin(), parts.end(),
                     [](const BrickGrid& part) { return part.empty() || LaneGrid::fits(part); });
}

VelocityGrids velocity_of(const Detail& detail) {
  VelocityGrids grids;
  if (const Displacement* const flow = detail.velocity())
    for (size_t a = 0; a < 3; ++a) grids[a] = LaneGrid::of_values(flow->field.parts[a]);
  return grids;
}

LaneDetail lane_detail(const Detail& detail, const VelocityGrids& velocity, int octaves) {
  LaneDetail lanes;
  lanes.amplitude = static_cast<float>(detail.amplitude());
  lanes.octaves = std::min(detail.octaves(), octaves);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      lanes.matrix[row][column] = static_cast<float>(detail.matrix()[column][row]);
    lanes.offset[row] = static_cast<float>(detail.offset()[row]);
    lanes.cell[row] = static_cast<int32_t>(detail.cell()[static_cast<size_t>(row)]);
  }
  double sum = 0;
  for (int o = 0; o < lanes.octaves; ++o) {
    lanes.weight[o] = static_cast<float>(detail.weight(o));
    lanes.weights_end[o] = static_cast<float>(sum += detail.weight(o));
  }
  lanes.phases = detail.phases();
  sum = 0;
  for (int i = 0; i < lanes.phases; ++i) {
    const Detail::Phase& phase = detail.phase(i);
    sum += phase.weight;
    lanes.phase[i] = {static_cast<float>(phase.weight), static_cast<float>(sum), static_cast<float>(phase.since),
                      static_cast<int32_t>(phase.seed)};
  }
  if (const Displacement* const flow = detail.velocity()) {
    lanes.carried = true;
    for (int a = 0; a < 3; ++a) {
      set_cells(lanes.velocity[a], velocity[static_cast<size_t>(a)]);
      lanes.velocity_shift[a] = static_cast<float>(flow->origin_shift[a]);
    }
  }
  return lanes;
}

}  // namespace brume
