#include "volume/placement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_access.hpp>

#include "base/error.h"

namespace brume {

std::string what_forbids_transform(const dmat4& m) {
  bool finite = true;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) finite = finite && std::isfinite(m[i][j]);
  const dmat3 linear(m);
  const double lengths = glm::length(linear[0]) * glm::length(linear[1]) * glm::length(linear[2]);
  const double determinant = glm::determinant(linear);
  // Relative to the edges' lengths, so that voxels of 1e-6 and of 1e6 are judged alike.
  if (!finite || !(std::abs(determinant) > 1e-12 * lengths))
    return fmt::format("singular (determinant {})", determinant);
  if (m[0][3] != 0 || m[1][3] != 0 || m[2][3] != 0 || m[3][3] != 1)
    return fmt::format("not affine: its last row is ({}, {}, {}, {})", m[0][3], m[1][3], m[2][3], m[3][3]);
  return "";
}

void check_transform(const dmat4& m, const char* what) {
  const std::string wrong = what_forbids_transform(m);
  if (wrong.empty()) return;
  throw InputError(fmt::format("{} is {}; expected {}", what, wrong,
                               wrong.starts_with("singular") ? "an invertible affine map" : "(0, 0, 0, 1)"));
}

dmat4 translation(const dvec3& t) {
  dmat4 m(1.0);
  m[3] = glm::dvec4(t, 1.0);
  return m;
}

Placement::Placement(const dmat4& world_from_local) {
  check_transform(world_from_local, "the volume's transform");
  world_from_local_ = dmat3(world_from_local);
  to_local_.matrix = glm::inverse(world_from_local_);
  world_offset_ = dvec3(world_from_local[3]);
  to_local_.offset = -(to_local_.matrix * world_offset_);
}

Placement::Placement(const ToLocal& to_local)
    : to_local_(to_local),
      world_from_local_(glm::inverse(to_local.matrix)),
      world_offset_(-(world_from_local_ * to_local.offset)) {}

RayCone Placement::to_local(const RayCone& world) const {
  double most = 0;
  for (const dvec3& row : {glm::row(to_local_.matrix, 0), glm::row(to_local_.matrix, 1), glm::row(to_local_.matrix, 2)})
    most = std::max(most, glm::length(row));
  return {to_local(world.middle), most * world.apart, most * world.apart_per_t};
}

dmat4 Placement::world_from_local() const {
  dmat4 m(world_from_local_);
  m[3] = glm::dvec4(world_offset_, 1.0);
  return m;
}

double Placement::voxel_size() const {
  return glm::min(glm::length(world_from_local_[0]),
                  glm::min(glm::length(world_from_local_[1]), glm::length(world_from_local_[2])));
}

}  // namespace brume
