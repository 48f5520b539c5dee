#pragma once
#include <optional>

#include "base/vec.h"
#include "volume/brick_grid.h"
#include "volume/phase_function.h"

namespace brume {

/// A density field in the world, with the coefficients that make it a scattering medium.
///
/// World space here is the renderer's: its origin is shifted near the medium (TRANSPORT.md section 10). Ray parameters
/// are the same numbers in world and local space, because local directions are not renormalised.
class Medium {
 public:
  Medium() = default;
  /// @param bricks           must outlive the medium
  /// @param world_from_index affine; any non-singular map
  /// @param sigma_t          extinction per density [1 / world unit]
  /// @throws InputError when the transform is singular or not finite
  Medium(const BrickGrid& bricks, const dmat4& world_from_index, double sigma_t, const dvec3& albedo, double g);

  const BrickGrid& bricks() const { return *bricks_; }
  double extinction_per_density() const { return sigma_t_; }
  const dvec3& albedo() const { return albedo_; }
  const HenyeyGreenstein& phase() const { return phase_; }

  Ray to_local(const Ray& world) const { return {to_local(world.o), local_from_world_ * world.d}; }
  dvec3 to_local(const dvec3& world) const { return local_from_world_ * world + local_offset_; }
  dvec3 to_world(const dvec3& local) const { return world_from_local_ * local + world_offset_; }
  /// Extinction at a local point [1 / world unit].
  double sigma_t(const dvec3& local) const { return sigma_t_ * bricks_->lookup(local); }
  /// A world-space gradient from a local one: the transform of covectors.
  dvec3 gradient_to_world(const dvec3& local) const { return glm::transpose(local_from_world_) * local; }
  /// World volume of one voxel.
  double voxel_volume() const { return std::abs(glm::determinant(world_from_local_)); }
  /// Shortest edge of a voxel [world units].
  double voxel_size() const;

  struct Sphere {
    dvec3 centre{0};
    double radius = 0;
  };
  /// Encloses the support, world space.
  Sphere bounding_sphere() const;

 private:
  const BrickGrid* bricks_ = nullptr;
  dmat3 local_from_world_{1}, world_from_local_{1};
  dvec3 local_offset_{0}, world_offset_{0};
  double sigma_t_ = 0;
  dvec3 albedo_{0};
  HenyeyGreenstein phase_;
};

/// Throws InputError unless the upper 3 x 3 part can be inverted and all is finite; `what` names it in the message.
void check_transform(const dmat4& m, const char* what);

}  // namespace brume
