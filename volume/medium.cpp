#include "volume/medium.h"

#include <fmt/format.h>

#include <cmath>

#include "base/error.h"

namespace brume {

void check_transform(const dmat4& m, const char* what) {
  bool finite = true;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) finite = finite && std::isfinite(m[i][j]);
  const dmat3 linear(m);
  const double lengths = glm::length(linear[0]) * glm::length(linear[1]) * glm::length(linear[2]);
  const double determinant = glm::determinant(linear);
  // Relative to the edges' lengths, so that voxels of 1e-6 and of 1e6 are judged alike.
  if (!finite || !(std::abs(determinant) > 1e-12 * lengths))
    throw InputError(
        fmt::format("{} is singular (determinant {}); expected an invertible affine map", what, determinant));
  if (m[0][3] != 0 || m[1][3] != 0 || m[2][3] != 0 || m[3][3] != 1)
    throw InputError(fmt::format("{} is not affine: its last row is ({}, {}, {}, {}); expected (0, 0, 0, 1)", what,
                                 m[0][3], m[1][3], m[2][3], m[3][3]));
}

Medium::Medium(const BrickGrid& bricks, const dmat4& world_from_index, double sigma_t, const dvec3& albedo, double g)
    : bricks_(&bricks), sigma_t_(sigma_t), albedo_(albedo), phase_{g} {
  check_transform(world_from_index, "the volume's transform");
  world_from_local_ = dmat3(world_from_index);
  local_from_world_ = glm::inverse(world_from_local_);
  world_offset_ = dvec3(world_from_index * glm::dvec4(dvec3(bricks.origin()), 1.0));
  local_offset_ = -(local_from_world_ * world_offset_);
}

double Medium::voxel_size() const {
  return glm::min(glm::length(world_from_local_[0]),
                  glm::min(glm::length(world_from_local_[1]), glm::length(world_from_local_[2])));
}

Medium::Sphere Medium::bounding_sphere() const {
  const dvec3 lo = bricks_->support_lo(), hi = bricks_->support_hi();
  Sphere sphere{to_world(0.5 * (lo + hi)), 0};
  for (int k = 0; k < 8; ++k) {
    const dvec3 corner{k & 1 ? hi.x : lo.x, k & 2 ? hi.y : lo.y, k & 4 ? hi.z : lo.z};
    sphere.radius = std::max(sphere.radius, glm::distance(sphere.centre, to_world(corner)));
  }
  return sphere;
}

}  // namespace brume
