#include "render/path_layers.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "volume/gradient.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

void find_medium_surface(const PathContext& context, std::span<const Medium> media, const Ray& ray, PathSample& s) {
  double first = kFar;
  const Medium* medium = nullptr;
  Ray local;
  for (const Medium& m : media) {
    const Ray r = m.to_local(ray);
    const auto t = find_surface(m, r, static_cast<float>(context.surface_density * m.maximum_density()));
    if (t && *t < first) first = *t, medium = &m, local = r;
  }
  if (medium) record_medium_surface(*medium, local, first, s);
}

/// The expectation of the gradient's direction at the first scattering, marched in half voxels. Each medium by itself:
/// overlaps are weighted as if the other were not there.
void record_weighted_gradient(std::span<const Medium> media, const Ray& ray, PathSample& s) {
  for (const Medium& m : media) {
    const Ray local = m.to_local(ray);
    const double h = 0.5 / glm::length(local.d);
    const auto [lo, hi] = m.support();
    const auto [t0, t1] = Solid{Solid::Shape::kBox, lo, hi}.intersect(local);
    double transmittance = 1;
    for (double t = std::max(t0, 0.0) + 0.5 * h; t < t1 && transmittance > 1e-3; t += h) {
      const double tau = m.sigma_t(local.at(t)) * h;
      if (!(tau > 0)) continue;
      const double weight = transmittance * -std::expm1(-tau);
      transmittance -= weight;
      if (const auto g = density_gradient(m, local.at(t)))
        s.gradient_transmittance_weighted += weight * glm::normalize(*g);
    }
  }
}

}  // namespace

void record_medium_surface(const Medium& medium, const Ray& local, double t, PathSample& s) {
  s.coverage = 1.0;
  // Half a voxel inside, where the differences see the medium on both sides.
  const double inside = t + 0.5 / glm::length(local.d);
  if (const auto gradient = density_gradient(medium, local.at(inside))) s.gradient = glm::normalize(*gradient);
}

void record_camera_ray(const PathContext& context, std::span<const Medium> media, const Ray& ray, PathSample& sample) {
  const Plan& plan = context.plan;
  if (plan.medium_surface && !plan.lanes) find_medium_surface(context, media, ray, sample);
  if (plan.optical_depth) {
    double tau = 0;
    for (const Medium& m : media) tau += optical_depth(m, m.to_local(ray), kFar);
    sample.optical_depth = std::min(tau, 50.0);
  }
  if (plan.weighted_gradient) record_weighted_gradient(media, ray, sample);
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
    for (const Medium& m : media) tau += optical_depth(m, m.to_local(Ray{p, towards}), distance);
    light *= std::exp(-tau);
  }
  return weight * albedo * light;
}

}  // namespace brume
