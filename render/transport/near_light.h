#pragma once
#include <algorithm>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "render/world/lights.h"
#include "volume/medium.h"

namespace brume {

// Light scattered once near a small light. Collisions that happen to lie close to it see 1 / r^2 of it, whose variance
// has no bound. So its contribution is split in two parts that add up to one at every point: the far part, bounded by
// 1 / c^2, is sampled at collisions as usual; the near part at points of the flight drawn with a density that follows
// 1 / r^2 itself.
//
// Source: Kulla, Fajardo 2012, Importance Sampling Techniques for Path Tracing in Participating Media, for the points;
// the split is ours: it lets thick media keep their collisions, and flights far from the light pay nothing.

struct NearLight {
  const Light* light;
  dvec3 position;
  double half_distance;  ///< c: at this distance both parts are a half

  /// The part that is left to collisions at a point.
  double far_part(const dvec3& p) const {
    const dvec3 d = position - p;
    return far_part(glm::dot(d, d));
  }
  double far_part(double r2) const { return r2 / (r2 + half_distance * half_distance); }
};

/// The part of a light's contribution at a point in a medium that is left to collisions: 1 but close to a near light.
inline double far_share(std::span<const NearLight> near_lights, const Light* light, const dvec3& p) {
  for (const NearLight& near : near_lights)
    if (near.light == light) return near.far_part(p);
  return 1.0;
}

/// Point, spot and sphere lights inside homogeneous media, which are even enough for it: in a grid, whose density says
/// more about where light scatters than the distance does, it gained nothing (docs/performance.md). That distance is a
/// fifth of the mean free path; beyond, collisions do as well.
/// @param setting  auto or off
std::vector<NearLight> choose_near_lights(std::span<const Medium> media, const Lights& lights,
                                          std::string_view setting);

/// Points of a ray between t0 and t1, equiangular as seen from a light.
class NearSegment {
 public:
  NearSegment(const NearLight& near, const Ray& ray, double t0, double t1) {
    const dvec3 to_light = near.position - ray.o;
    nearest_ = glm::dot(to_light, ray.d);
    distance_ = std::max(glm::length(to_light - nearest_ * ray.d), 1e-9 * near.half_distance);
    from_ = std::atan((t0 - nearest_) / distance_);
    to_ = std::atan((t1 - nearest_) / distance_);
    lo_ = t0;
    hi_ = t1;
    const double closest = std::clamp(nearest_, t0, std::max(t0, t1)) - nearest_;
    worth_ = std::min(1.0, 2 * (1 - near.far_part(distance_ * distance_ + closest * closest)));
  }

  /// Probability with which the near part should be sampled at all: as the largest share it has on the segment.
  double worth() const { return worth_; }

  /// A ray parameter and its density.
  std::pair<double, double> sample(double u) const {
    const double x = distance_ * std::tan(from_ + u * (to_ - from_));
    return {std::clamp(nearest_ + x, lo_, hi_), distance_ / ((to_ - from_) * (distance_ * distance_ + x * x))};
  }

 private:
  double nearest_, distance_, from_, to_, lo_, hi_, worth_;
};

}  // namespace brume
