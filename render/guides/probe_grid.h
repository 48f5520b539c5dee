#pragma once
#include <array>
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
  const dvec3& spacing() const { return spacing_; }
  /// The nearest place between the outermost probes.
  dvec3 inside(const dvec3& world) const { return glm::clamp(world, at(0), at(count() - 1)); }

  /// Eight probes and their weights, of sum 1.
  struct Around {
    std::array<int, 8> probe{};
    std::array<double, 8> weight{};
  };
  /// Linear between the probes, as on the border beyond the outermost.
  Around around(const dvec3& world) const;

 private:
  dvec3 lo_{0}, spacing_{1};
  ivec3 n_{1};
};

}  // namespace brume
