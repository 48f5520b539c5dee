#include "volume/tracking.h"

#include <cmath>

namespace brume {
namespace {

// Of a medium in closed form: the density's integral along its chord, from t = 0 to t_max.
double density_integral(const Medium& medium, const Ray& local, double t_max) {
  const HomogeneousShape& shape = *medium.homogeneous();
  const auto [enters, leaves] = shape.intersect(local);
  const double t0 = std::max(enters, 0.0), t1 = std::min(leaves, t_max);
  return t0 < t1 ? shape.integral(local, t0, t1) : 0.0;
}

}  // namespace

Collision sample_collision(const Medium& medium, const Ray& local, double t_max, int hero, Rng& rng,
                           TrackingCounters& counters) {
  TentativeCollisions points(medium, local, t_max, rng);
  TentativeCollision point;
  Collision collision;
  while (points.next(point, rng, counters)) {
    const dvec3 real = medium.extinction_ratio() * std::min(1.0, point.density / point.majorant);
    const bool hit = rng.uniform() < real[hero];
    collision.probability *= hit ? real : 1.0 - real;
    if (!hit) continue;
    collision.t = point.t;
    break;
  }
  return collision;
}

dvec3 estimate_transmittance(const Medium& medium, const Ray& local, double t_max, Rng& rng,
                             TrackingCounters& counters) {
  if (medium.homogeneous()) return glm::exp(-medium.coefficients().sigma_t * density_integral(medium, local, t_max));
  TentativeCollisions points(medium, local, t_max, rng);
  TentativeCollision point;
  dvec3 weight(1);
  while (points.next(point, rng, counters)) {
    weight *= 1.0 - medium.extinction_ratio() * (point.density / point.majorant);
    const double largest = max_component(weight);
    if (largest >= kLeastTransmittance) continue;
    if (!(rng.uniform() < largest / kSurvivingTransmittance)) return dvec3(0);
    weight *= kSurvivingTransmittance / largest;
  }
  return weight;
}

double optical_depth(const Medium& medium, const Ray& ray, double t_max) {
  if (medium.homogeneous()) return medium.extinction_per_density() * density_integral(medium, ray, t_max);
  MajorantWalk walk = medium.walk(ray, 0.0, t_max);
  const double across = 1e-20 * max_component(glm::abs(ray.d));  // such a ray never reaches the axis's planes
  MajorantWalk::Segment s;
  double sum = 0;
  // Detail is a polynomial between the points of its lattice; so many parts of a voxel's length lie within one, about.
  const double parts = medium.detail() ? medium.detail()->finest() * glm::length(ray.d) : 0;
  while (walk.next(s)) {
    double t = s.t0;
    while (t < s.t1) {
      // The next voxel face on any axis; a step of rounding size past it, so that the walk moves on.
      const dvec3 p = ray.at(t);
      double next = s.t1;
      for (int a = 0; a < 3; ++a) {
        if (std::abs(ray.d[a]) <= across) continue;
        const double plane = ray.d[a] > 0 ? std::floor(p[a] + 1e-9) + 1 : std::ceil(p[a] - 1e-9) - 1;
        next = std::min(next, (plane - ray.o[a]) / ray.d[a]);
      }
      if (!(next > t)) next = std::nextafter(t, kUnbounded);
      const int pieces = std::max(1, static_cast<int>(std::ceil((next - t) * parts)));
      for (int i = 0; i < pieces; ++i) {
        const double half = 0.5 * (next - t) / pieces, centre = 0.5 * (t + next) + (2 * i + 1 - pieces) * half,
                     x = half * std::sqrt(0.6);
        const auto density = [&](double at) { return medium.density(s, ray.at(at)); };
        sum += half * (8.0 / 9 * density(centre) + 5.0 / 9 * (density(centre - x) + density(centre + x)));
      }
      t = next;
    }
  }
  return sum * medium.extinction_per_density();
}

std::array<double, 3> depths_along_axes(const Medium& medium) {
  const auto [lo, hi] = medium.support();
  const dvec3 middle = 0.5 * (lo + hi);
  std::array<double, 3> depths{};
  for (int a = 0; a < 3; ++a) {
    dvec3 start = middle, end = middle;
    start[a] = lo[a];
    end[a] = hi[a];
    const double length = glm::distance(medium.to_world(start), medium.to_world(end));
    depths[static_cast<size_t>(a)] = optical_depth(medium, Ray{start, (end - start) / length}, length);
  }
  return depths;
}

}  // namespace brume
