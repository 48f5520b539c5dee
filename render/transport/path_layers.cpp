#include "render/transport/path_layers.h"

#include <algorithm>
#include <cmath>

#include "volume/gradient.h"

namespace brume {
std::optional<dvec3> isosurface_gradient(const Medium& medium, const Ray& local, double t) {
  const auto gradient = density_gradient(medium, local.at(t + 0.5 / glm::length(local.d)));
  return gradient ? std::optional(glm::normalize(*gradient)) : std::nullopt;
}

dvec3 record_first_scatter(const PathContext& context, std::span<const Medium> media, const Medium& medium,
                           const dvec3& eye, const dvec3& p, const dvec3& d, const dvec3& weight, const dvec3& albedo,
                           PathSample& s) {
  const double w = (weight.x + weight.y + weight.z) / 3.0;
  s.scatter_share = w;
  s.scatter_depth = w * glm::distance(eye, p);
  s.scatter_position = w * (p + context.world_shift);
  s.albedo = w * albedo;
  const dvec3 local = medium.to_local(p);
  s.scatter_density = w * medium.density(local);
  if (!context.plan.first_scatter_gradient) return dvec3(0);
  const auto gradient = density_gradient(medium, local);
  if (gradient) s.gradient_first_scatter = w * glm::normalize(*gradient);
  if (!context.plan.flash) return dvec3(0);
  // Falloff for depth and shading by the gradient for relief: a plain lamp would show opacity only.
  const FlashLamp& lamp = context.flash;
  const bool at_eye = lamp.offset == dvec3(0);
  const dvec3 way = eye + lamp.offset - p;
  const double distance = std::max(glm::length(way), 1e-12 * lamp.distance), ratio = lamp.distance / distance;
  const dvec3 towards = at_eye ? -d : way / distance;
  double light = medium.phase().value(at_eye ? -1.0 : glm::dot(d, towards));
  if (lamp.falloff) light *= std::clamp(ratio * ratio, 0.25, 4.0);
  if (gradient && lamp.shading) {
    const double steepness = glm::length(*gradient), share = steepness / (steepness + lamp.typical_gradient);
    light *= 1 - share + share * std::max(0.0, -glm::dot(*gradient / steepness, towards));
  }
  if (!at_eye) {
    double tau = 0;
    const Ray ray{p, towards};
    for (const Medium& m : media)
      m.each_met(ray, distance,
                 [&](const Medium& one, size_t) { tau += optical_depth(one, one.to_local(ray), distance); });
    light *= std::exp(-tau);
  }
  return weight * albedo * light;
}

}  // namespace brume
