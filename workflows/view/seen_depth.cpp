#include "workflows/view/seen_depth.h"

#include <algorithm>
#include <cmath>

#include "volume/tracking.h"

namespace brume {
namespace {

constexpr double kFar = 1e30;  // scene units

}  // namespace

std::optional<double> seen_depth(const PathContext& context, const Ray& ray) {
  const auto depth_to = [&](double t) {
    double sum = 0;
    for (const Medium& m : context.media)
      m.each_met(ray, t, [&](const Medium& one, size_t) { sum += optical_depth(one, one.to_local(ray), t); });
    return sum;
  };
  const std::optional<SurfaceHit> hit = context.surfaces ? context.surfaces->intersect(ray, kFar) : std::nullopt;
  double far = 0;
  for (const Medium& m : context.media) {
    const Medium::Sphere sphere = m.bounding_sphere();
    far = std::max(far, glm::distance(ray.o, sphere.centre) + sphere.radius);
  }
  if (hit) far = std::min(far, hit->t);
  const double whole = far > 0 ? depth_to(far) : 0;
  if (whole < 0.05) return hit ? std::optional(hit->t) : std::nullopt;
  const double wanted = -std::log(1 - 0.5 * (1 - std::exp(-whole)));
  double lo = 0, hi = far;
  for (int step = 0; step < 40; ++step) {
    const double middle = 0.5 * (lo + hi);
    (depth_to(middle) < wanted ? lo : hi) = middle;
  }
  return hi;
}

}  // namespace brume
