#include "render/transport/path_layers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/math.h"
#include "volume/gradient.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

void find_nearest_isosurface(const PathContext& context, std::span<const Medium> media, const Ray& ray, PathSample& s) {
  double first = kFar;
  const Medium* medium = nullptr;
  Ray local;
  for (const Medium& m : media) {
    const Ray r = m.to_local(ray);
    const auto t = find_isosurface(m, r, static_cast<float>(context.isosurface_density * m.maximum_density()));
    if (t && *t < first) {
      first = *t;
      medium = &m;
      local = r;
    }
  }
  if (medium) record_isosurface(*medium, local, first, s);
}

struct March {
  double depth = 0;
  std::array<double, kMarchedPoints> point;  ///< ray parameters; negative past the end
};

/// See lanes_march: the same estimator, interpolated. Each medium by itself: overlaps are weighted as if the other were
/// not there.
March march(const Medium& m, const Ray& local, Rng& rng) {
  March result;
  result.point.fill(-1);
  if (m.homogeneous()) {
    result.depth = optical_depth(m, local, kFar);
    return result;  // no gradient inside
  }
  const double step = 1.0 / glm::length(local.d), offset = rng.uniform(), u = rng.uniform();
  MajorantWalk walk = m.walk(local, 0.0, kFar);
  MajorantWalk::Segment s;
  size_t next = 0;
  const auto level = [&] { return -portable_log(1 - (static_cast<double>(next) + u) / kMarchedPoints); };
  double wanted = level();
  while (result.depth < kDeepest && walk.next(s))
    for (double t = s.t0; t < s.t1; t += step) {
      const double length = std::min(step, s.t1 - t), at = t + offset * length;
      const double sigma = m.density(s, local.at(at)) * m.extinction_per_density(),
                   after = result.depth + sigma * length;
      for (; next < kMarchedPoints && after >= wanted; wanted = ++next < kMarchedPoints ? level() : kFar)
        result.point[next] = t + (wanted - result.depth) / sigma;
      result.depth = after;
    }
  return result;
}

}  // namespace

void record_isosurface(const Medium& medium, const Ray& local, double t, PathSample& s) {
  s.coverage = 1.0;
  // Half a voxel inside, where the differences see the medium on both sides.
  const double inside = t + 0.5 / glm::length(local.d);
  if (const auto gradient = density_gradient(medium, local.at(inside))) s.gradient = glm::normalize(*gradient);
}

void record_camera_ray(const PathContext& context, std::span<const Medium> media, const Ray& ray, Rng rng,
                       PathSample& sample) {
  const Plan& plan = context.plan;
  if (plan.isosurface) find_nearest_isosurface(context, media, ray, sample);
  if (!plan.marched()) return;
  double depth = 0;
  for (const Medium& m : media) {
    const Ray local = m.to_local(ray);
    const March marched = march(m, local, rng);
    depth += marched.depth;
    if (!plan.weighted_gradient) continue;
    for (const double t : marched.point)
      if (t >= 0)
        if (const auto g = density_gradient(m, local.at(t)))
          sample.gradient_transmittance_weighted += glm::normalize(*g) / static_cast<double>(kMarchedPoints);
  }
  sample.optical_depth = std::min(depth, kDeepest);
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
