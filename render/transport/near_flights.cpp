#include "render/transport/near_flights.h"

#include <algorithm>
#include <cmath>

#include "render/transport/estimator.h"

namespace brume {

NearFlights::NearFlights(const PathContext& context, PathStates& paths, WorldPaths& world, MediaFlights& flights,
                         TrackingCounters& counters)
    : c_(context), p_(paths), w_(world), flights_(flights), counters_(counters) {
  if (!c_.plan.near_lights.empty())
    for (const Medium& m : c_.media) spheres_.push_back(m.bounding_sphere());
}

void NearFlights::add(const SlotList& rays) {
  for (const NearLight& near : c_.plan.near_lights)
    for (const size_t i : rays) add(near, i);
}

/// From the first to the last point of a ray that may lie in a medium.
std::pair<double, double> NearFlights::part_in_media(const Ray& ray, double end) const {
  double t0 = end, t1 = 0;
  for (const Medium::Sphere& ball : spheres_) {
    const double middle = glm::dot(ball.centre - ray.o, ray.d), off = glm::distance(ray.at(middle), ball.centre);
    if (!(off < ball.radius)) continue;
    const double half = std::sqrt(ball.radius * ball.radius - off * off);
    t0 = std::min(t0, std::max(0.0, middle - half));
    t1 = std::max(t1, std::min(end, middle + half));
  }
  return {t0, t1};
}

void NearFlights::add(const NearLight& near, size_t i) {
  const Ray& ray = w_.ray[i];
  const auto [t0, t1] = part_in_media(ray, w_.end[i]);
  if (!(t1 > t0)) return;
  const NearSegment segment(near, ray, t0, t1);
  PathGenerator numbers(p_, i);
  if (!(numbers.uniform() < segment.worth())) return;
  const auto [t, pdf] = segment.sample(numbers.uniform());
  const dvec3 p = ray.at(t);
  const LightSample sample = near.light->sample(p, numbers.pair());
  if (!(sample.pdf > 0)) return;
  dvec3 scattered(0);
  const std::span<const Medium> media = media_at(c_, w_.time[i]);
  for (const Medium& any : media)
    any.each_around(p, [&](const Medium& m, size_t) {
      const double density = m.density(m.to_local(p));
      counters_.look_up();
      if (density > 0)
        scattered += m.coefficients().sigma_t * (density * m.phase().value(glm::dot(ray.d, sample.wi))) * m.albedo(p);
    });
  dvec3 L = scattered * sample.radiance * ((1 - near.far_part(p)) / (pdf * segment.worth() * sample.pdf));
  const Ray shadow{p, sample.wi};
  if (L == dvec3(0) || c_.lights->blocked(shadow, sample.distance, near.light)) return;
  if (c_.surfaces) L *= c_.surfaces->passage(shadow, sample.distance * (1.0 - 1e-4), w_.time[i]).light;
  if (L == dvec3(0)) return;
  Rng rng = numbers.stream();
  L *= flights_.transmittance(media, shadow, sample.distance, rng) * flights_.transmittance(media, ray, t, rng);
  deposit(p_, w_, i, p_.throughput[i] * vec3(L), p_.events[i] + 1, near.light->group);
}

}  // namespace brume
