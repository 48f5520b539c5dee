#pragma once
#include <algorithm>
#include <vector>

#include "volume/brick_grid.h"

namespace brume {

/// Calls do_cell once for each cell that lies in one or more boxes, which hold their corners. Sweeps a plane along x
/// in which the corners of the boxes that it cuts are counted, so that boxes may be many, large and alike.
template <class DoCell>
void each_cell_in_any(std::vector<VoxelBox> boxes, const DoCell& do_cell) {
  if (boxes.empty()) return;
  VoxelBox all = boxes[0];
  for (const VoxelBox& box : boxes) all = {glm::min(all.lo, box.lo), glm::max(all.hi, box.hi)};
  const int height = all.hi.y - all.lo.y + 1, width = all.hi.z - all.lo.z + 1;
  std::vector<int> corners(static_cast<size_t>(height + 1) * static_cast<size_t>(width + 1));
  const auto at = [&](int y, int z) {
    return static_cast<size_t>(y) * static_cast<size_t>(width + 1) + static_cast<size_t>(z);
  };
  const auto count = [&](const VoxelBox& box, int sign) {
    const ivec3 lo = box.lo - all.lo, hi = box.hi - all.lo + 1;
    corners[at(lo.y, lo.z)] += sign, corners[at(hi.y, hi.z)] += sign;
    corners[at(lo.y, hi.z)] -= sign, corners[at(hi.y, lo.z)] -= sign;
  };
  std::vector<VoxelBox> ending = boxes;
  std::sort(boxes.begin(), boxes.end(), [](const VoxelBox& a, const VoxelBox& b) { return a.lo.x < b.lo.x; });
  std::sort(ending.begin(), ending.end(), [](const VoxelBox& a, const VoxelBox& b) { return a.hi.x < b.hi.x; });
  size_t begun = 0, ended = 0;
  for (int x = all.lo.x; x <= all.hi.x; ++x) {
    for (; begun < boxes.size() && boxes[begun].lo.x == x; ++begun) count(boxes[begun], 1);
    for (; ended < ending.size() && ending[ended].hi.x < x; ++ended) count(ending[ended], -1);
    std::vector<int> above(static_cast<size_t>(width));
    for (int y = 0; y < height; ++y) {
      int along = 0;
      for (int z = 0; z < width; ++z) {
        along += corners[at(y, z)];
        above[static_cast<size_t>(z)] += along;
        if (above[static_cast<size_t>(z)] > 0) do_cell(all.lo + ivec3(x - all.lo.x, y, z));
      }
    }
  }
}

}  // namespace brume
