#pragma once
#include <string>
#include <vector>

#include "volume/displacement.h"

namespace brume {

/// Displacements on the lattice of the density that they move, in voxels per frame, and the box that they are known in.
struct ExtendedVelocity {
  VectorBricks field;
  VoxelBox box;
};

/// A stored velocity wherever the density that it moves may arrive. Parameters, errors: as displacement_over.
ExtendedVelocity extend_velocity(const StoredVelocity& velocity, const ScalarField& density,
                                 const ShutterMotion& motion, std::vector<std::string>& notes, const Task& task);

}  // namespace brume
