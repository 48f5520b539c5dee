#include "volume/gradient.h"

#include <cmath>

#include "volume/tracking.h"

namespace brume {
namespace {

// Gradient in voxels, by central differences of half width h at the corners of the voxel cell around p.
dvec3 interpolated_differences(const BrickGrid& bricks, const dvec3& p, int h) {
  const ivec3 base(glm::floor(p));
  const dvec3 f = p - dvec3(base);
  dvec3 gradient(0);
  for (int corner = 0; corner < 8; ++corner) {
    const ivec3 o(corner & 1, corner >> 1 & 1, corner >> 2);
    const ivec3 v = base + o;
    const double weight = (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z);
    for (int a = 0; a < 3; ++a) {
      ivec3 step(0);
      step[a] = h;
      gradient[a] += weight * (static_cast<double>(bricks.voxel(v + step)) - bricks.voxel(v - step)) / (2.0 * h);
    }
  }
  return gradient;
}

}  // namespace

std::optional<dvec3> density_gradient(const Medium& medium, const dvec3& local) {
  const BrickGrid& bricks = medium.bricks();
  for (const int h : {1, 2, 4}) {
    const dvec3 g = interpolated_differences(bricks, local, h);
    if (glm::length(g) >= 1e-4 * bricks.maximum()) return medium.gradient_to_world(g);
  }
  return std::nullopt;
}

std::optional<double> find_surface(const Medium& medium, const Ray& ray, float iso) {
  const BrickGrid& bricks = medium.bricks();
  if (bricks.empty()) return std::nullopt;
  if (bricks.lookup(ray.o) >= iso) return 0.0;
  const double step = 0.5 / glm::length(ray.d);
  MajorantWalk walk(bricks, ray, 0.0, std::numeric_limits<double>::infinity());
  MajorantWalk::Segment s;
  while (walk.next(s)) {
    if (s.majorant < iso) continue;
    const int steps = std::max(1, static_cast<int>(std::ceil((s.t1 - s.t0) / step)));
    for (int i = 1; i <= steps; ++i) {
      const double t1 = s.t0 + (s.t1 - s.t0) * i / steps;
      if (bricks.lookup_in(*s.cell, s.coordinates, ray.at(t1)) < iso) continue;
      double lo = s.t0 + (s.t1 - s.t0) * (i - 1) / steps, hi = t1;
      for (int k = 0; k < 8; ++k) {
        const double mid = 0.5 * (lo + hi);
        (bricks.lookup_in(*s.cell, s.coordinates, ray.at(mid)) < iso ? lo : hi) = mid;
      }
      return hi;
    }
  }
  return std::nullopt;
}

double optical_depth(const Medium& medium, const Ray& ray, double t_max) {
  const BrickGrid& bricks = medium.bricks();
  MajorantWalk walk(bricks, ray, 0.0, t_max);
  MajorantWalk::Segment s;
  double sum = 0;
  while (walk.next(s)) {
    double t = s.t0;
    while (t < s.t1) {
      // The next voxel face on any axis; a step of rounding size past it, so that the walk moves on.
      const dvec3 p = ray.at(t);
      double next = s.t1;
      for (int a = 0; a < 3; ++a) {
        if (std::abs(ray.d[a]) < 1e-20) continue;
        const double plane = ray.d[a] > 0 ? std::floor(p[a] + 1e-9) + 1 : std::ceil(p[a] - 1e-9) - 1;
        next = std::min(next, (plane - ray.o[a]) / ray.d[a]);
      }
      if (!(next > t)) next = std::nextafter(t, std::numeric_limits<double>::infinity());
      const double centre = 0.5 * (t + next), half = 0.5 * (next - t), x = half * std::sqrt(0.6);
      const auto density = [&](double at) {
        return static_cast<double>(bricks.lookup_in(*s.cell, s.coordinates, ray.at(at)));
      };
      sum += half * (8.0 / 9 * density(centre) + 5.0 / 9 * (density(centre - x) + density(centre + x)));
      t = next;
    }
  }
  return sum * medium.extinction_per_density();
}

}  // namespace brume
