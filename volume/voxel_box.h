#pragma once
#include "volume/brick_grid.h"

namespace brume {

/// Makes a box hold another one, too.
inline void enclose(VoxelBox& box, const VoxelBox& other) {
  if (other.empty()) return;
  const bool first = box.empty();
  box.lo = first ? other.lo : glm::min(box.lo, other.lo);
  box.hi = first ? other.hi : glm::max(box.hi, other.hi);
}

inline VoxelBox common(const VoxelBox& a, const VoxelBox& b) {
  return {glm::max(a.lo, b.lo), glm::min(a.hi, b.hi)};
}

inline bool inside(const VoxelBox& box, const ivec3& v) {
  return glm::all(glm::greaterThanEqual(v, box.lo)) && glm::all(glm::lessThanEqual(v, box.hi));
}

/// Of three counts; in double, because those of hostile files can pass 2^63.
inline double product(const ivec3& counts) {
  return static_cast<double>(counts.x) * counts.y * counts.z;
}

}  // namespace brume
