#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/progress.h"
#include "render/guides/guide_media.h"
#include "render/guides/lattice.h"

namespace brume {

/// Optical depth towards parallel light, from every point of the media.
///
/// The lattice is sheared so that its columns are rays towards the light: along each column the depth is summed, so
/// that nothing is smeared on the way, however far the light has come.
class SunDepth {
 public:
  SunDepth() = default;
  /// @param towards     unit vector to the light
  /// @param spacing     of the lattice [world units]; wider where that would make more than `most_nodes`
  SunDepth(const GuideMedia& media, GuideColour colour, const dvec3& towards, double spacing, size_t most_nodes,
           const Task& task);

  /// The same depths, in the same memory, where everything has moved as far.
  SunDepth moved(const dvec3& by) const {
    SunDepth depth = *this;
    depth.origin_ += by;
    return depth;
  }

  /// At a world point; linear between the nodes.
  float at(const dvec3& world) const { return at_place(place(world)); }
  /// A world ray in the lattice's coordinates.
  struct Line {
    dvec3 start{0}, along{0};
  };
  Line line(const Ray& ray) const { return {place(ray.o), sheared(ray.d)}; }
  size_t bytes() const { return roots_->size() * sizeof(uint16_t); }

  /// Depths are kept as their roots in 16 bits: within 0.001 at a depth of 1, up to the largest that matters.
  static constexpr float kLargest = 676, kRootStep = 26.0f / 65535;
  const uint16_t* roots() const { return roots_->data(); }
  /// Nodes along a column and across; columns lie one behind another, the last axis the faster one.
  const ivec3& nodes() const { return n_; }

 private:
  /// Lattice coordinates: along the column, and the two across.
  dvec3 place(const dvec3& world) const { return sheared(world - origin_); }
  dvec3 sheared(const dvec3& p) const {
    const double along = p[axis_];
    return {along * inverse_, (p[u_] - along * slope_u_) * inverse_, (p[v_] - along * slope_v_) * inverse_};
  }

  float at_place(const dvec3& place) const;

  dvec3 origin_{0};
  double inverse_ = 1, slope_u_ = 0, slope_v_ = 0;
  int axis_ = 0, u_ = 1, v_ = 2;
  static float depth_of(uint16_t root) {
    const float r = kRootStep * static_cast<float>(root);
    return r * r;
  }
  static uint16_t root_of(float depth) {
    return static_cast<uint16_t>(std::sqrt(std::min(depth, kLargest)) / kRootStep + 0.5f);
  }
  using Roots = std::vector<uint16_t, LazyZeros<uint16_t>>;
  ivec3 n_{0};                          // along, u, v
  std::shared_ptr<const Roots> roots_;  // v fastest but for the column, which is contiguous
};

}  // namespace brume
