#pragma once
#include <array>
#include <vector>

#include "render/lanes/lane_scene.h"
#include "render/lanes/path_states.h"

namespace brume {

/// A field that glows: its cells, and the emission coefficient as a function of its value, linear between entries.
struct EmissionCells : LaneCells {
  std::array<const float*, 3> colour;  ///< the entries, by channel
  float lowest, scale, last;           ///< of the values; entries per value; number of the last entry
};

/// An EmissionField as the kernels need it.
struct LaneEmission {
  LaneEmission(const EmissionField& field, const LaneGrid& grid);
  LaneEmission(const LaneEmission&) = delete;  // the cells refer to its table
  LaneEmission& operator=(const LaneEmission&) = delete;

  const Medium& shape;
  HomogeneousShape box;
  std::array<std::vector<float>, 3> table;
  EmissionCells cells{};
};

/// Segments of flights that lie in such a field, by slot.
struct EmissionSegments {
  PathStates::Column<float> ox, oy, oz, dx, dy, dz;  ///< rays in local coordinates of the field
  PathStates::Column<float> end;                     ///< ray parameter
  PathStates::Column<float> stride;                  ///< voxels that one look-up stands for
  PathStates::Column<float> r, g, b;                 ///< the result
};

/// The integral of the emission coefficient along each segment: one look-up for each stride, all of them at the same
/// place in it, which is drawn for each segment.
void lanes_emission(const EmissionCells& cells, PathStates& paths, const SlotList& rays, EmissionSegments& segments);

}  // namespace brume
