#pragma once
#include "volume/medium.h"

namespace brume {

/// The motion of a density over the shutter, with what bounds it.
/// @param velocity     voxels per frame, on the density's lattice
/// @param box          voxels that any velocity or density reaches
/// @param open, close  shutter, in frames around the density's own time
Displacement displacement_over(VectorBricks velocity, const VoxelBox& box, const BrickGrid& density, double open,
                               double close, const Task& task);

}  // namespace brume
