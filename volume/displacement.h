#pragma once
#include <array>
#include <string>
#include <vector>

#include "volume/medium.h"

namespace brume {

struct ScalarField;
struct ShutterMotion;

/// A velocity as it is stored: world units of its file per unit of time, each component on a lattice of its own.
struct StoredVelocity {
  struct Component {
    BrickGrid values;
    BrickGrid stored;           ///< 1 where a value is stored
    dmat4 world_from_index{1};  ///< the voxel (i, j, k) sits at (i, j, k) - shift
    dvec3 shift{0};             ///< of staggered grids
    VoxelBox box;               ///< of the voxels that are stored
  };
  std::string name;
  std::array<Component, 3> components;
  std::vector<std::string> notes;
};

/// The motion of a density over the shutter, with what bounds it.
///
/// The density at x is the one stored at x - s v(x), so v must be known wherever the density may arrive. Where none is
/// stored, and where there is neither velocity nor density, it is that of the nearest voxels that have one. Density
/// without a velocity stands still, but for what lies within four voxels of one.
/// @throws InputError for a velocity far away from the density
Displacement displacement_over(const StoredVelocity& velocity, const ScalarField& density, const ShutterMotion& motion,
                               std::vector<std::string>& notes, const Task& task);

}  // namespace brume
