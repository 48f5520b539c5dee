#pragma once
#include <vector>

#include "volume/medium.h"

namespace brume {

/// The most tentative collisions that delta tracking is expected to take in one crossing of a cell, over all cells of a
/// medium: large where one voxel lies far above those around it. In a cell of width L with densities from m to M it is
/// sigma M L, but no more than M / m, after which one of them is real. 0 for a homogeneous medium.
double most_tentative_collisions(const Medium& medium);

/// The densities that these shares of a grid's positive voxels do not exceed, from a million of them at most.
/// @param shares  each in [0, 1]
/// @return        as many; empty where no voxel is positive
std::vector<double> density_quantiles(const BrickGrid& grid, const std::vector<double>& shares);

}  // namespace brume
