#pragma once
#include <optional>

#include "volume/displacement.h"
#include "volume/voxel_reader.h"

namespace brume {

/// A component of a stored velocity, asked for at the voxels of a density.
class VelocityComponent {
 public:
  VelocityComponent(const StoredVelocity::Component& component, const dmat4& world_from_density);

  /// The value of a whole brick that is stored and constant, as in tiles.
  std::optional<float> of_brick(const ivec3& lo) const;
  /// Nothing where no value is stored around the voxel; else the mean of those that are, by their trilinear weights.
  std::optional<float> operator()(const ivec3& v);

 private:
  dmat4 from_density_;
  dvec3 shift_;
  bool one_lattice_;
  VoxelReader values_, stored_;
};

}  // namespace brume
