#pragma once
#include <string>

#include "volume/ray_cone.h"

namespace brume {

/// Where a lattice lies in the world: an affine map between its local coordinates and the renderer's world space, whose
/// origin is shifted near the volumes (docs/methods.md, Numerical rules). Local directions are not renormalised, so
/// that ray parameters are the same numbers, world distances, in both spaces.
class Placement {
 public:
  /// The way from the world to local coordinates; doubles alone, for kernels.
  struct ToLocal {
    dmat3 matrix{1};
    dvec3 offset{0};
    dvec3 operator()(const dvec3& world) const { return matrix * world + offset; }
    Ray operator()(const Ray& world) const { return {(*this)(world.o), matrix * world.d}; }
  };

  Placement() = default;
  /// @throws InputError when the map is singular, not affine or not finite
  explicit Placement(const dmat4& world_from_local);
  explicit Placement(const ToLocal& to_local);

  Ray to_local(const Ray& world) const { return to_local_(world); }
  /// @param world  its bounds must hold in every direction, not only along the axes
  RayCone to_local(const RayCone& world) const;
  dvec3 to_local(const dvec3& world) const { return to_local_(world); }
  const ToLocal& to_local() const { return to_local_; }
  dvec3 to_world(const dvec3& local) const { return world_from_local_ * local + world_offset_; }
  /// A world-space gradient from a local one: the transform of covectors.
  dvec3 gradient_to_world(const dvec3& local) const { return glm::transpose(to_local_.matrix) * local; }
  const dmat3& local_from_world() const { return to_local_.matrix; }
  dmat4 world_from_local() const;
  /// World volume of one voxel.
  double voxel_volume() const { return std::abs(glm::determinant(world_from_local_)); }
  /// Shortest edge of a voxel [world units].
  double voxel_size() const;

 private:
  ToLocal to_local_;
  dmat3 world_from_local_{1};
  dvec3 world_offset_{0};
};

/// "singular (determinant 0)", "not affine ...": why a matrix is no place in space; empty where it is one.
std::string what_forbids_transform(const dmat4& m);

/// Throws InputError unless the upper 3 x 3 part can be inverted and all is finite; `what` names it in the message.
void check_transform(const dmat4& m, const char* what);

/// A shift by t.
dmat4 translation(const dvec3& t);

}  // namespace brume
