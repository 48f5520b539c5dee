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
struct MediaFlights::Replay {
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
    scenes_.push_back(lane_scene(context, m, world));
    replays_.push_back(medium.chromatic() && !medium.homogeneous() ? std::make_unique<Replay>() : nullptr);
    placed_.push_back(medium.transform_moves() ? std::make_unique<Placements>() : nullptr);
    const auto [lo, hi] = medium.support();
    bounds_.push_back(medium.homogeneous().value_or(HomogeneousShape{HomogeneousShape::Shape::kBox, lo, hi}));
    boxes_.push_back({placed_[m] ? placed_[m]->data() : &medium.placement().to_local(), placed_[m] != nullptr,
                      bounds_[m].lo, bounds_[m].hi, medium.walked_shift(), scenes_[m].unit});
  }
}

MediaFlights::Start MediaFlights::start(size_t slot, const PathRequest& request) {
  if (c_.plan.one_grid) return start_in_grid(slot, request);
  w_.ray[slot] = request.ray;
  w_.time[slot] = request.time;
  p_.time[slot] = static_cast<float>(request.time);
  for (size_t m = 0; m < placed_.size(); ++m)
    if (placed_[m]) (*placed_[m])[slot] = c_.media[m].placement_at(request.time).to_local();
  return {c_.surfaces || met_by(request.ray, request.time), 0};
}

MediaFlights::Start MediaFlights::start_in_grid(size_t slot, const PathRequest& request) {
  const bool ends = c_.plan.finite_lights || c_.plan.emission;  // else nothing asks for it
  if (ends) w_.ray[slot] = request.ray;
  if (!(request.start.medium < EntryBound::kNever)) return {false, -1};
  const Medium& medium = c_.media[0];
  const double unit = scenes_[0].unit;
  const Ray local = medium.to_local(request.ray);
  const auto [enters, leaves] = bounds_[0].intersect(local);
  const double entry = std::max(static_cast<double>(request.start.medium), enters), surface = request.start.surface;
  if (!(entry < leaves)) return {false, -1};
  p_.flight.o.set(slot, vec3(local.at(entry)));
  p_.flight.d.set(slot, vec3(local.d * unit));
  w_.begin[slot] = ends ? glm::dot(medium.to_world(dvec3(p_.flight.o[slot])) - request.ray.o, request.ray.d) : entry;
  return {true, surface < leaves ? static_cast<float>(std::max(surface - entry, 0.0) / unit) : -1.0f};
}

bool MediaFlights::met_by(const Ray& ray, double time) const {
  for (size_t m = 0; m < bounds_.size(); ++m) {
    const auto [enters, leaves] = bounds_[m].intersect(c_.media[m].placement_at(time).to_local(ray));
    if (std::max(enters, 0.0) < leaves) return true;
  }
  return false;
}

void MediaFlights::enter(size_t m, const SlotList& rays, const std::array<double, kPool>& end, SlotList& inside) {
  inside.clear();
  enter_box(boxes_[m], w_.ray, end, rays, p_.flight, w_.begin, inside);
}

void MediaFlights::fly_in_grid(const SlotList& rays, SlotList& hits, SlotList& escapes) {
  lanes_fly(scenes_[0], p_, rays, hits, escapes, counters_.lookups);
}

void MediaFlights::fly_first_in_grid(const SlotList& rays, SlotList& hits, SlotList& escapes) {
  lanes_fly_first(scenes_[0], p_, rays, hits, escapes, counters_.lookups);
}

MediaFlights::Flown MediaFlights::fly(const SlotList& rays) {
  for (size_t m = 0; m < count(); ++m) {
    if (Replay* const replay = replays_[m].get())
      for (const size_t i : rays) {
        replay->probability[i] = vec3(1);
        replay->end[i] = 0;
        replay->generator[i] = PathGenerator(p_, i).state();
      }
    switch (c_.plan.media[m]) {
      case Precision::kClosedForm:
        fly_through_shape(m, rays);
        break;
      case Precision::kLanes:
        fly_in_lanes(m, rays);
        break;
      case Precision::kDouble:
        fly_in_double(m, rays);
    }
  }
  return {*this, rays};
}

/// The part of a path's ray that lies inside a homogeneous medium.
std::pair<double, double> MediaFlights::part_in_shape(size_t m, size_t slot, const Ray& ray, double end) const {
  return part_inside(bounds_[m], to_local(m, slot, ray), end);
}

/// In closed form, by the extinction of the path's hero channel.
void MediaFlights::fly_through_shape(size_t m, const SlotList& rays) {
  for (const size_t i : rays) {
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
  hits_.clear();
  passed_.clear();
  lanes_fly(scenes_[m], p_, inside_, hits_, passed_, counters_.lookups);
  for (const size_t i : hits_) {
    w_.end[i] = std::min(w_.end[i], w_.begin[i] + static_cast<double>(p_.travel[i]) * scenes_[m].unit);
    w_.medium[i] = static_cast<int32_t>(m);
  }
  Replay* const flown = replays_[m].get();
  if (!flown) return;
  for (const size_t i : inside_) {
    flown->probability[i] = p_.flight_factor[i];
    flown->end[i] = w_.end[i];
  }
}

void MediaFlights::fly_in_double(size_t m, const SlotList& rays) {
  for (const size_t i : rays) {
    const Collision collision = fly_one(m, i, w_.end[i]);
    if (collision.t >= 0) {
      w_.end[i] = collision.t;
      w_.medium[i] = static_cast<int32_t>(m);
    }
    if (Replay* const replay = replays_[m].get()) {
      replay->probability[i] = vec3(collision.probability);
      replay->end[i] = w_.end[i];
    }
  }
}

Collision MediaFlights::fly_one(size_t m, size_t i, double end) {
  const Medium now = c_.media[m].at_time(w_.time[i]);
  Rng rng = PathGenerator(p_, i).stream();
  return sample_collision(now, now.to_local(w_.ray[i]), end, c_.plan.chromatic ? p_.hero[i] : 0, rng, counters_);
}

/// The same walks through a chromatic grid again, with the numbers that they were flown with, up to ends that lie
/// before any collision of theirs: each channel's probability of passing.
void MediaFlights::replay(size_t m, const SlotList& rays, const std::array<double, kPool>& end,
                          std::array<vec3, kPool>& probability) {
  Replay& flown = *replays_[m];
  for (const size_t i : rays) {
    probability[i] = vec3(1);
    flown.resumed[i] = PathGenerator(p_, i).state();
    PathGenerator(p_, i).set(flown.generator[i]);
  }
  if (in_lanes(m)) {
    enter(m, rays, end, inside_);
    hits_.clear();
    passed_.clear();
    lanes_fly(scenes_[m], p_, inside_, hits_, passed_, counters_.lookups);
    for (const size_t i : passed_) probability[i] = p_.flight_factor[i];
  } else {
    for (const size_t i : rays) probability[i] = vec3(fly_one(m, i, end[i]).probability);
  }
  for (const size_t i : rays) PathGenerator(p_, i).set(flown.resumed[i]);
}

void MediaFlights::passing(const SlotList& rays, const std::array<double, kPool>& end,
                           std::array<vec3, kPool>& factor) {
  for (const size_t i : rays) factor[i] = vec3(1);
  for (size_t m = 0; m < count(); ++m) {
    if (replays_[m]) replay(m, rays, end, replayed_);
    for (const size_t i : rays) {
      factor[i] *= replays_[m] ? replayed_[i] : vec3(density_in_shape(m, i, end[i]));
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
    if (!replays_[m]) continue;
    again_.clear();
    for (const size_t i : rays) {
      if (w_.end[i] < replays_[m]->end[i]) again_.push(i);
    }
    replay(m, again_, w_.end, replays_[m]->probability);
  }
  for (const size_t i : rays) {
    dvec3 factor(1);
    for (size_t m = 0; m < count(); ++m) {
      factor *= replays_[m] ? dvec3(replays_[m]->probability[i]) : density_in_shape(m, i, w_.end[i]);
      if (!replays_[m] && w_.medium[i] == static_cast<int32_t>(m)) factor *= c_.media[m].extinction_ratio();
    }
    const vec3 change(channel_weights(p_, i, factor));
    p_.throughput.set(i, p_.throughput[i] * change);
    p_.channel_density.set(i, p_.channel_density[i] * change);
  }
}

dvec3 channel_weights(const PathStates& p, size_t i, const dvec3& factor) {
  const dvec3 density = dvec3(p.channel_density[i]) * factor;
  const double mean = (density.x + density.y + density.z) / 3;
  return mean > 0 ? factor / mean : dvec3(0);
}

void MediaFlights::shadow(const SlotList& rays) {
  if (c_.plan.one_grid) {
    lanes_shadow(scenes_[0], p_, rays, counters_.lookups);
    return;
  }
  if (c_.plan.chromatic)
    for (const size_t i : rays) p_.shadow_colour.set(i, vec3(1));
  // What costs no look-up first: a ray that is dark already plays roulette at its first collision.
  for (size_t m = 0; m < count(); ++m)
    if (c_.plan.media[m] == Precision::kClosedForm) shadow_through_shape(m, rays);
  for (size_t m = 0; m < count(); ++m) {
    if (c_.plan.media[m] == Precision::kLanes) shadow_in_lanes(m, rays);
    if (c_.plan.media[m] == Precision::kDouble) shadow_in_double(m, rays);
  }
}

/// Whether nothing is left of a shadow ray's light.
bool MediaFlights::dark(size_t i) const {
  return !(p_.transmittance[i] > 0) || (c_.plan.chromatic && !(max_component(p_.shadow_colour[i]) > 0));
}

/// Dims a shadow ray's light.
void MediaFlights::dim(size_t medium, size_t i, const dvec3& passes) {
  if (c_.media[medium].chromatic())
    p_.shadow_colour.set(i, p_.shadow_colour[i] * vec3(passes));
  else
    p_.transmittance[i] *= static_cast<float>(passes.x);
}

void MediaFlights::shadow_through_shape(size_t m, const SlotList& rays) {
  for (const size_t i : rays) {
    const auto [t0, t1] = part_in_shape(m, i, w_.shadow[i], w_.shadow_end[i]);
    if (t0 < t1) dim(m, i, glm::exp(-c_.media[m].coefficients().sigma_t * (t1 - t0)));
  }
}

void MediaFlights::shadow_in_lanes(size_t m, const SlotList& rays) {
  inside_.clear();
  again_.clear();
  for (const size_t i : rays)
    if (!dark(i)) again_.push(i);
  enter_box(boxes_[m], w_.shadow, w_.shadow_end, again_, p_.shadow, w_.begin, inside_);
  lanes_shadow(scenes_[m], p_, inside_, counters_.lookups);
}

void MediaFlights::shadow_in_double(size_t m, const SlotList& rays) {
  for (const size_t i : rays) {
    if (dark(i)) continue;
    const Medium now = c_.media[m].at_time(w_.time[i]);
    Rng rng = PathGenerator(p_, i).stream();
    dim(m, i, transmittance({&now, 1}, w_.shadow[i], w_.shadow_end[i], rng));
  }
}

dvec3 MediaFlights::transmittance(std::span<const Medium> media, const Ray& ray, double end, Rng& rng) const {
  dvec3 product(1);
  for (const Medium& m : media)
    if (product != dvec3(0)) product *= estimate_transmittance(m, m.to_local(ray), end, rng, counters_);
  return product;
}

}  // namespace brume
