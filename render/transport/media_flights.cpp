#include "render/transport/media_flights.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "render/transport/flights.h"
#include "volume/tracking.h"

namespace brume {
namespace {

/// The part of a local ray inside a shape, from 0 to `end`; empty (first >= second) where there is none.
std::pair<double, double> part_inside(const HomogeneousShape& shape, const Ray& local, double end) {
  const auto [enters, leaves] = shape.intersect(local);
  return {std::max(enters, 0.0), std::min(leaves, end)};
}

}  // namespace

/// Flights through a chromatic grid: what each channel's probability of them is, and what is needed to fly them again.
struct MediaFlights::Flown {
  std::array<vec3, kPool> probability;
  std::array<double, kPool> end;                      ///< ray parameter up to which the probability counts
  std::array<PathGenerator::State, kPool> generator;  ///< before the flight
  std::array<PathGenerator::State, kPool> resumed;    ///< after it, while it is flown again
};

MediaFlights::~MediaFlights() = default;

MediaFlights::MediaFlights(const PathContext& context, PathStates& paths, WorldPaths& world, TrackingCounters& counters)
    : c_(context), p_(paths), w_(world), counters_(counters) {
  for (size_t m = 0; m < c_.media.size(); ++m) {
    const Medium& medium = c_.media[m];
    kinds_.push_back(medium.homogeneous()                ? Kind::kShape
                     : single_precision_resolves(medium) ? Kind::kLanes
                                                         : Kind::kDouble);
    scenes_.push_back(lane_scene(context, m, &world));
    flown_.push_back(medium.chromatic() && !medium.homogeneous() ? std::make_unique<Flown>() : nullptr);
    placed_.push_back(medium.transform_moves() ? std::make_unique<Placements>() : nullptr);
    const auto [lo, hi] = medium.support();
    bounds_.push_back(medium.homogeneous() ? *medium.homogeneous()
                                           : HomogeneousShape{HomogeneousShape::Shape::kBox, lo, hi});
    boxes_.push_back({placed_[m] ? placed_[m]->data() : &medium.placement().to_local(), placed_[m] != nullptr, lo, hi,
                      medium.walked_shift(), scenes_[m].unit});
  }
}

void MediaFlights::place(size_t slot, double time) {
  for (size_t m = 0; m < placed_.size(); ++m)
    if (placed_[m]) (*placed_[m])[slot] = c_.media[m].placement_at(time).to_local();
}

bool MediaFlights::met_by(const Ray& ray, double time) const {
  for (size_t m = 0; m < bounds_.size(); ++m) {
    const auto [enters, leaves] = bounds_[m].intersect(c_.media[m].placement_at(time).to_local(ray));
    if (std::max(enters, 0.0) < leaves) return true;
  }
  return false;
}

void MediaFlights::enter(size_t m, const SlotList& rays, const std::array<double, kPool>& end, SlotList& inside) {
  inside.count = 0;
  enter_box(boxes_[m], w_.ray, end, rays, {p_.ox, p_.oy, p_.oz, p_.lx, p_.ly, p_.lz, p_.t_max, w_.begin}, inside);
}

void MediaFlights::fly(const SlotList& rays) {
  for (size_t m = 0; m < count(); ++m) {
    if (Flown* const flown = flown_[m].get())
      for (size_t k = 0; k < rays.count; ++k) {
        const auto i = static_cast<size_t>(rays.slot[k]);
        flown->probability[i] = vec3(1);
        flown->end[i] = 0;
        flown->generator[i] = PathGenerator(p_, i).state();
      }
    switch (kinds_[m]) {
      case Kind::kShape:
        fly_through_shape(m, rays);
        break;
      case Kind::kLanes:
        fly_in_lanes(m, rays);
        break;
      case Kind::kDouble:
        fly_in_double(m, rays);
    }
  }
}

/// The part of a path's ray that lies inside a homogeneous medium.
std::pair<double, double> MediaFlights::part_in_shape(size_t m, size_t slot, const Ray& ray, double end) const {
  return part_inside(bounds_[m], to_local(m, slot, ray), end);
}

/// In closed form, by the extinction of the path's hero channel.
void MediaFlights::fly_through_shape(size_t m, const SlotList& rays) {
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    const auto [t0, t1] = part_in_shape(m, i, w_.ray[i], w_.end[i]);
    if (!(t0 < t1)) continue;
    const double sigma = c_.media[m].coefficients().sigma_t[c_.plan.chromatic ? p_.hero[i] : 0];
    const double t = t0 + PathGenerator(p_, i).exponential() / sigma;
    if (!(t < t1)) continue;
    w_.end[i] = t;
    w_.medium[i] = static_cast<int32_t>(m);
  }
}

void MediaFlights::fly_in_lanes(size_t m, const SlotList& rays) {
  enter(m, rays, w_.end, inside_);
  hits_.count = passed_.count = 0;
  lanes_fly(scenes_[m], p_, inside_, hits_, passed_, counters_.lookups);
  for (size_t k = 0; k < hits_.count; ++k) {
    const auto i = static_cast<size_t>(hits_.slot[k]);
    w_.end[i] = std::min(w_.end[i], w_.begin[i] + static_cast<double>(p_.t_max[i]) * scenes_[m].unit);
    w_.medium[i] = static_cast<int32_t>(m);
  }
  Flown* const flown = flown_[m].get();
  if (!flown) return;
  for (size_t k = 0; k < inside_.count; ++k) {
    const auto i = static_cast<size_t>(inside_.slot[k]);
    flown->probability[i] = {p_.fr[i], p_.fg[i], p_.fb[i]};
    flown->end[i] = w_.end[i];
  }
}

void MediaFlights::fly_in_double(size_t m, const SlotList& rays) {
  Flown* const flown = flown_[m].get();
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    const double t = fly_one(m, i, w_.end[i]);
    if (t >= 0) {
      w_.end[i] = t;
      w_.medium[i] = static_cast<int32_t>(m);
    }
    if (!flown) continue;
    flown->probability[i] = {p_.fr[i], p_.fg[i], p_.fb[i]};
    flown->end[i] = w_.end[i];
  }
}

/// One flight in double precision: the ray parameter of the hero channel's collision, or a negative number.
/// PathStates::fr, fg, fb get each channel's probability of what happened.
double MediaFlights::fly_one(size_t m, size_t i, double end) {
  const Medium now = c_.media[m].at_time(w_.time[i]);
  const dvec3 ratio = c_.plan.chromatic ? now.extinction_ratio() : dvec3(1);
  const int hero = c_.plan.chromatic ? p_.hero[i] : 0;
  Rng rng = PathGenerator(p_, i).stream();
  TentativeCollisions points(now, now.to_local(w_.ray[i]), end, rng);
  TentativeCollision point;
  dvec3 probability(1);
  double t = -1;
  while (t < 0 && points.next(point, rng, counters_)) {
    const dvec3 real = ratio * std::min(1.0, point.density / point.majorant);
    const bool hit = rng.uniform() < real[hero];
    probability *= hit ? real : 1.0 - real;
    if (hit) t = point.t;
  }
  p_.fr[i] = static_cast<float>(probability.x);
  p_.fg[i] = static_cast<float>(probability.y);
  p_.fb[i] = static_cast<float>(probability.z);
  return t;
}

/// The same walks through a chromatic grid again, with the numbers that they were flown with, up to ends that lie
/// before any collision of theirs: each channel's probability of passing.
void MediaFlights::replay(size_t m, const SlotList& rays, const std::array<double, kPool>& end,
                          std::array<vec3, kPool>& probability) {
  Flown& flown = *flown_[m];
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    probability[i] = vec3(1);
    flown.resumed[i] = PathGenerator(p_, i).state();
    PathGenerator(p_, i).set(flown.generator[i]);
  }
  const auto take = [&](const SlotList& slots) {
    for (size_t k = 0; k < slots.count; ++k) {
      const auto i = static_cast<size_t>(slots.slot[k]);
      probability[i] = {p_.fr[i], p_.fg[i], p_.fb[i]};
    }
  };
  if (in_lanes(m)) {
    enter(m, rays, end, inside_);
    hits_.count = passed_.count = 0;
    lanes_fly(scenes_[m], p_, inside_, hits_, passed_, counters_.lookups);
    take(passed_);
  } else {
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      fly_one(m, i, end[i]);
    }
    take(rays);
  }
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    PathGenerator(p_, i).set(flown.resumed[i]);
  }
}

void MediaFlights::passing(const SlotList& rays, const std::array<double, kPool>& end,
                           std::array<vec3, kPool>& factor) {
  for (size_t k = 0; k < rays.count; ++k) factor[static_cast<size_t>(rays.slot[k])] = vec3(1);
  for (size_t m = 0; m < count(); ++m) {
    if (flown_[m]) replay(m, rays, end, replayed_);
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      factor[i] *= flown_[m] ? replayed_[i] : vec3(density_in_shape(m, i, end[i]));
    }
  }
}

/// Each channel's probability density of passing a homogeneous medium, up to a factor that all have.
dvec3 MediaFlights::density_in_shape(size_t m, size_t i, double end) const {
  const Medium& medium = c_.media[m];
  if (!medium.chromatic()) return dvec3(1);
  const auto [t0, t1] = part_in_shape(m, i, w_.ray[i], end);
  const dvec3 sigma = medium.coefficients().sigma_t;
  return t0 < t1 ? glm::exp((sigma[p_.hero[i]] - sigma) * (t1 - t0)) : dvec3(1);
}

void MediaFlights::weigh_channels(const SlotList& rays) {
  // Where a flight went past the path's collision with another medium, only what lies before that counts.
  for (size_t m = 0; m < count(); ++m) {
    if (!flown_[m]) continue;
    again_.count = 0;
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      if (w_.end[i] < flown_[m]->end[i]) again_.push(rays.slot[k]);
    }
    replay(m, again_, w_.end, flown_[m]->probability);
  }
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    dvec3 factor(1);
    for (size_t m = 0; m < count(); ++m) {
      factor *= flown_[m] ? dvec3(flown_[m]->probability[i]) : density_in_shape(m, i, w_.end[i]);
      if (!flown_[m] && w_.medium[i] == static_cast<int32_t>(m)) factor *= c_.media[m].extinction_ratio();
    }
    const dvec3 change = channel_weights(p_, i, factor);
    p_.tr[i] *= static_cast<float>(change.x);
    p_.tg[i] *= static_cast<float>(change.y);
    p_.tb[i] *= static_cast<float>(change.z);
    p_.qr[i] *= static_cast<float>(change.x);
    p_.qg[i] *= static_cast<float>(change.y);
    p_.qb[i] *= static_cast<float>(change.z);
  }
}

dvec3 channel_weights(const PathStates& p, size_t i, const dvec3& factor) {
  const dvec3 density = dvec3(p.qr[i], p.qg[i], p.qb[i]) * factor;
  const double mean = (density.x + density.y + density.z) / 3;
  return mean > 0 ? factor / mean : dvec3(0);
}

void MediaFlights::shadow(const SlotList& rays) {
  for (size_t k = 0; c_.plan.chromatic && k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    p_.shadow_r[i] = p_.shadow_g[i] = p_.shadow_b[i] = 1;
  }
  // What costs no look-up first: a ray that is dark already plays roulette at its first collision.
  for (size_t m = 0; m < count(); ++m)
    if (kinds_[m] == Kind::kShape) shadow_through_shape(m, rays);
  for (size_t m = 0; m < count(); ++m) {
    if (kinds_[m] == Kind::kLanes) shadow_in_lanes(m, rays);
    if (kinds_[m] == Kind::kDouble) shadow_in_double(m, rays);
  }
}

/// Whether nothing is left of a shadow ray's light.
bool MediaFlights::dark(size_t i) const {
  return !(p_.transmittance[i] > 0) ||
         (c_.plan.chromatic && !(std::max({p_.shadow_r[i], p_.shadow_g[i], p_.shadow_b[i]}) > 0));
}

/// Dims a shadow ray's light.
void MediaFlights::dim(size_t medium, size_t i, const dvec3& passes) {
  if (!c_.media[medium].chromatic()) {
    p_.transmittance[i] *= static_cast<float>(passes.x);
    return;
  }
  p_.shadow_r[i] *= static_cast<float>(passes.x);
  p_.shadow_g[i] *= static_cast<float>(passes.y);
  p_.shadow_b[i] *= static_cast<float>(passes.z);
}

void MediaFlights::shadow_through_shape(size_t m, const SlotList& rays) {
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    const auto [t0, t1] = part_in_shape(m, i, w_.shadow[i], w_.shadow_end[i]);
    if (t0 < t1) dim(m, i, glm::exp(-c_.media[m].coefficients().sigma_t * (t1 - t0)));
  }
}

void MediaFlights::shadow_in_lanes(size_t m, const SlotList& rays) {
  inside_.count = again_.count = 0;
  for (size_t k = 0; k < rays.count; ++k)
    if (!dark(static_cast<size_t>(rays.slot[k]))) again_.push(rays.slot[k]);
  enter_box(boxes_[m], w_.shadow, w_.shadow_end, again_,
            {p_.ox, p_.oy, p_.oz, p_.sx, p_.sy, p_.sz, p_.shadow_t_max, w_.begin}, inside_);
  lanes_shadow(scenes_[m], p_, inside_, counters_.lookups);
}

void MediaFlights::shadow_in_double(size_t m, const SlotList& rays) {
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    if (dark(i)) continue;
    const Medium now = c_.media[m].at_time(w_.time[i]);
    Rng rng = PathGenerator(p_, i).stream();
    dim(m, i, transmittance({&now, 1}, w_.shadow[i], w_.shadow_end[i], rng));
  }
}

dvec3 MediaFlights::transmittance(std::span<const Medium> media, const Ray& ray, double end, Rng& rng) const {
  dvec3 product(1);
  for (const Medium& m : media) {
    if (product == dvec3(0)) break;
    if (m.chromatic())
      product *= estimate_chromatic_transmittance(m, m.to_local(ray), end, rng, counters_);
    else
      product *= estimate_transmittance(m, m.to_local(ray), end, rng, counters_);
  }
  return product;
}

}  // namespace brume
