#pragma once
#include <cstdint>
#include <functional>

#include "volume/brick_grid.h"

namespace brume {

/// A density on a lattice, computed from a seed.
struct ProceduralVolume {
  VoxelBox box;
  double voxel_size;  ///< the longest side of the box is about 2 world units
  std::function<float(const ivec3&)> density;
  std::function<bool(const VoxelBox&)> is_zero;  ///< whether a box is known to hold nothing; null: no box is
};

/// A cumulus: overlapping spheres on a flat base, their surface displaced by fractal noise.
/// @param resolution voxels along the longest side
ProceduralVolume procedural_cloud(int resolution, uint64_t seed);

/// A rising plume: a column that widens and bends with height, torn by domain-warped fractal noise.
ProceduralVolume procedural_smoke(int resolution, uint64_t seed);

}  // namespace brume
