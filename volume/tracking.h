#pragma once
#include <cstdint>

#include "base/rng.h"
#include "volume/medium.h"

namespace brume {

/// What the estimators did, for reports; one per thread, summed at the end.
struct TrackingCounters {
  uint64_t lookups = 0;              ///< interpolated density look-ups
  uint64_t collisions = 0;           ///< real ones
  uint64_t majorant_violations = 0;  ///< look-ups above the bound; a bug unless 0
  void merge(const TrackingCounters& other) {
    lookups += other.lookups, collisions += other.collisions, majorant_violations += other.majorant_violations;
  }
};

// Interpolation rounds, so the bound is widened by more than a float's rounding and by less than anyone can measure.
inline constexpr double kMajorantMargin = 1.0 + 1e-6;

/// Calls visit(t, density, majorant) at the points of a Poisson process whose rate is the majorant of the extinction,
/// in order along a ray, until it returns true or the ray leaves the medium or passes t_max.
/// @param ray  local coordinates of `medium`, parametrised by world distance; from t = 0
template <class Visit>
void visit_tentative_collisions(const Medium& medium, const Ray& ray, double t_max, Rng& rng,
                                TrackingCounters& counters, const Visit& visit) {
  const double k = medium.extinction_per_density();
  MajorantWalk walk(medium.bricks(), ray, 0.0, t_max);
  MajorantWalk::Segment segment;
  double tau = rng.exponential();  // carried across cells: the same process as drawing anew in each, for less
  while (walk.next(segment)) {
    const double majorant = segment.majorant * kMajorantMargin, sigma_maj = k * majorant;
    double t = segment.t0;
    for (;;) {
      const double remaining = (segment.t1 - t) * sigma_maj;
      if (tau >= remaining) {
        tau -= remaining;
        break;
      }
      t += tau / sigma_maj;
      const double density = medium.bricks().lookup_in(*segment.cell, segment.coordinates, ray.at(t));
      ++counters.lookups;
      counters.majorant_violations += density > majorant;
      if (visit(t, density, majorant)) return;
      tau = rng.exponential();
    }
  }
}

/// The distance to the next real collision, by delta tracking through the majorant grid: density sigma_t exp(-tau).
///
/// @param ray  as in visit_tentative_collisions
/// @return     the ray parameter, or a negative number where the ray leaves the medium or passes t_max uncollided
/// Source: Woodcock 1965.  Proof: tests/volume/tracking_test.cpp
inline double sample_collision(const Medium& medium, const Ray& ray, double t_max, Rng& rng,
                               TrackingCounters& counters) {
  double hit = -1.0;
  visit_tentative_collisions(medium, ray, t_max, rng, counters, [&](double t, double density, double majorant) {
    if (!(rng.uniform() * majorant < density)) return false;
    ++counters.collisions;
    hit = t;
    return true;
  });
  return hit;
}

/// Unbiased transmittance along a ray, by ratio tracking: each tentative collision multiplies the weight by the null
/// share 1 - sigma_t / sigma_maj. Below 0.05 the weight plays roulette.
///
/// @param ray  as in visit_tentative_collisions
/// @return     in [0, 1]; exactly 1 where the ray misses the medium
/// Source: Novak, Selle, Jarosz 2014.  Proof: tests/volume/tracking_test.cpp
inline double estimate_transmittance(const Medium& medium, const Ray& ray, double t_max, Rng& rng,
                                     TrackingCounters& counters) {
  double weight = 1.0;
  visit_tentative_collisions(medium, ray, t_max, rng, counters, [&](double, double density, double majorant) {
    weight *= 1.0 - density / majorant;
    if (weight >= 0.05) return false;
    const bool survives = rng.uniform() < weight / 0.1;
    weight = survives ? 0.1 : 0.0;
    return !survives;
  });
  return weight;
}

/// Optical depth of a ray by regular marching, exact but for rounding: the field is a cubic in t between voxel faces,
/// which three-point Gauss-Legendre quadrature integrates without error. For tests and reports, not for the inner loop.
double optical_depth(const Medium& medium, const Ray& ray, double t_max);

}  // namespace brume
