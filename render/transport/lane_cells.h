#pragma once
#include <cstdint>

#include "volume/lane_grid.h"

namespace brume {

/// A LaneGrid as the kernels read it.
struct LaneCells {
  const float* majorant;
  const int32_t* brick;
  const float* values;
  float nx, ny, nz;
  int32_t nz_int;
  float cell, inverse_cell;  ///< voxels along a cell
  int32_t stored;            ///< values along a brick
};

/// @param cells  refers to the grid afterwards
void set_cells(LaneCells& cells, const LaneGrid& grid);

}  // namespace brume
