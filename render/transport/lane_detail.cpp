#include "render/transport/lane_detail.h"

#include <algorithm>
#include <cmath>

#include "volume/detail_flow.h"
#include "volume/tracking.h"

namespace brume {

LaneDetail lane_detail(const Detail& detail, int octaves) {
  LaneDetail lanes;
  lanes.amplitude = static_cast<float>(detail.amplitude());
  lanes.greatest = static_cast<float>(detail.greatest() * kMajorantMargin);
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
  if (const DetailFlow* const flow = detail.velocity()) {
    lanes.flow = flow->points.data();
    lanes.row = flow->count.z;
    lanes.plane = flow->count.y * flow->count.z;
    lanes.inverse_spacing = 1.0f / static_cast<float>(flow->spacing);
    for (int a = 0; a < 3; ++a) {
      lanes.points[a] = static_cast<float>(flow->count[a]);
      lanes.step[a] = static_cast<float>(std::ldexp(flow->quantum[a], -DetailFlow::kBits * a));
      lanes.rest[a] = static_cast<float>(std::ldexp(1.0 * DetailFlow::kRest, DetailFlow::kBits * a));
    }
  }
  return lanes;
}

}  // namespace brume
