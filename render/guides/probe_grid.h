#pragma once
#include <array>
#include <cmath>
#include <cstddef>

#include "base/vec.h"

namespace brume {

/// Points in the middle of the cells of a box, at which light that varies slowly is kept.
class ProbeGrid {
 public:
  ProbeGrid() = default;
  /// @param across  cells along the longest side
  ProbeGrid(const dvec3& lo, const dvec3& hi, int across);

  int count() const { return n_.x * n_.y * n_.z; }
  dvec3 at(int probe) const;
  /// Where the outermost probes lie.
  const dvec3& lo() const { return lo_; }
  dvec3 hi() const { return lo_ + spacing_ * dvec3(n_ - 1); }

  /// Eight probes and their weights, of sum 1.
  struct Around {
    std::array<int, 8> probe{};
    std::array<double, 8> weight{};
  };
  /// Linear between the probes, as on the border beyond the outermost.
  Around around(const dvec3& world) const;
  /// The same for a point of a surface: probes behind it hardly count, because they do not know what it faces.
  /// @param outside  called as outside(probe): whether it lies outside of solids
  template <class Outside>
  Around before(const dvec3& world, const dvec3& normal, const Outside& outside) const {
    constexpr double kHidden = 1e-3;
    Around found = around(world);
    double sum = 0;
    for (size_t k = 0; k < 8; ++k) {
      const bool faced = glm::dot(at(found.probe[k]) - world, normal) > 0;
      found.weight[k] = (found.weight[k] + 1e-6) * (faced ? 1.0 : kHidden) * (outside(found.probe[k]) ? 1.0 : kHidden);
      sum += found.weight[k];
    }
    for (double& weight : found.weight) weight /= sum;
    return found;
  }

 private:
  dvec3 lo_{0}, spacing_{1};
  ivec3 n_{1};
};

/// What a diffuse surface of albedo 1 reflects at a place, by the six directions along the axes that its normal may
/// have, and squared components of the normal in between: exact for a normal along an axis, whatever the light.
/// Source: McTaggart 2004, Half-Life 2 / Valve Source Shading (ambient cube).
struct AmbientCube {
  std::array<dvec3, 6> face{};  ///< towards -x, x, -y, y, -z, z

  /// @param radiance  from a direction, times its share of the sphere
  void add(const dvec3& radiance, const dvec3& direction) {
    for (int axis = 0; axis < 3; ++axis)
      face[static_cast<size_t>(2 * axis + (direction[axis] > 0 ? 1 : 0))] += 4.0 * std::abs(direction[axis]) * radiance;
  }
  dvec3 onto(const dvec3& normal) const {
    dvec3 sum(0);
    for (int axis = 0; axis < 3; ++axis)
      sum += normal[axis] * normal[axis] * face[static_cast<size_t>(2 * axis + (normal[axis] > 0 ? 1 : 0))];
    return sum;
  }
};

}  // namespace brume
