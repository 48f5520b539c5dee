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
  if (c_.plan.instances) visits_ = std::make_unique<InstanceVisits>();
  for (size_t m = 0; m < c_.media.size(); ++m) {
    const Medium& medium = c_.media[m];
    scenes_.push_back(lane_scene(context, m, world));
    replays_.push_back(medium.chromatic() && !medium.homogeneous() ? std::make_unique<Replay>() : nullptr);
    placed_.push_back(medium.transform_moves() ? std::make_unique<Placements>() : nullptr);
    const auto [lo, hi] = medium.support();
    bounds_.push_back(medium.homogeneous().value_or(HomogeneousShape{HomogeneousShape::Shape::kBox, lo, hi}));
    boxes_.push_back({placed_[m] ? placed_[m]->data() : &medium.placement().to_local(), placed_[m] != nullptr,
                      bounds_[m].lo, bounds_[m].hi, medium.walked_shift(), scenes_[m].unit,
                      medium.instances() ? medium.instances()->data() : nullptr,
                      visits_ ? visits_->instance.data() : nullptr});
  }
}

MediaFlights::Start MediaFlights::start(size_t slot, const PathRequest& request) {
  if (c_.plan.one_grid) return start_in_grid(slot, request);
  w_.ray[slot] = request.ray;
  w_.time[slot] = request.time;
  w_.last_collision[slot] = {};
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
    if (const Instances* const all = c_.media[m].instances()) {
      if (all->meets(ray, kUnbounded)) return true;
      continue;
    }
    const auto [enters, leaves] = bounds_[m].intersect(c_.media[m].placement_at(time).to_local(ray));
    if (std::max(enters, 0.0) < leaves) return true;
  }
  return false;
}

void MediaFlights::enter(size_t m, const SlotList& rays, const std::array<double, kPool>& end, SlotList& inside) {
  inside.clear();
  enter_box(boxes_[m], w_.ray, end, rays, p_.flight, w_.begin, inside);
}

/// Takes rays through a grid as far as they cross it before their ends: walk() does so with those in inside_. Through
/// instances they go one after the other, nearest first. @param left  whether a ray still has to
template <class Left, class Walk>
void MediaFlights::walk_grid(size_t m, const SlotList& rays, const std::array<Ray, kPool>& from,
                             const std::array<double, kPool>& end, LocalRays& to, const Left& left, const Walk& walk) {
  const Instances* const instances = c_.media[m].instances();
  going_ = rays;
  if (instances)
    for (const size_t i : rays) {
      const WorldPaths::Place& last = w_.last_collision[i];
      visits_->begin(i, last.medium == static_cast<int32_t>(m) ? last.instance : -1);
    }
  do {
    going_.keep_if([&](size_t i) { return left(i) && (!instances || visits_->next(*instances, i, from[i], end[i])); });
    inside_.clear();
    enter_box(boxes_[m], from, end, going_, to, w_.begin, inside_);
    walk();
  } while (instances && going_.count > 0);
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

/// Calls visit(local ray, t0, t1, extinction per that of the medium, instance) for the parts of a path's ray that lie
/// inside a medium of closed form. @param end  may become less meanwhile
template <class Visit>
void MediaFlights::each_part_in_shape(size_t m, size_t slot, const Ray& ray, const double& end,
                                      const Visit& visit) const {
  const Instances* const instances = c_.media[m].instances();
  if (!instances) {
    const Ray local = to_local(m, slot, ray);
    if (const auto [t0, t1] = part_inside(bounds_[m], local, end); t0 < t1) visit(local, t0, t1, 1.0, size_t{0});
    return;
  }
  instances->each_met(ray, end, [&](size_t number) {
    const Instance& one = (*instances)[number];
    const Ray local = one.to_local(ray);
    if (const auto [t0, t1] = part_inside(bounds_[m], local, end); t0 < t1) visit(local, t0, t1, one.density, number);
  });
}

/// In closed form, by the extinction of the path's hero channel.
void MediaFlights::fly_through_shape(size_t m, const SlotList& rays) {
  for (const size_t i : rays) {
    const double sigma = c_.media[m].coefficients().sigma_t[c_.plan.chromatic ? p_.hero[i] : 0];
    each_part_in_shape(m, i, w_.ray[i], w_.end[i],
                       [&](const Ray& local, double t0, double t1, double density, size_t instance) {
                         const double depth = PathGenerator(p_, i).exponential() / (sigma * density);
                         const double t = bounds_[m].reaches(local, t0, depth);
                         if (t < t1) collide(i, t, m, instance);
                       });
  }
}

void MediaFlights::fly_in_lanes(size_t m, const SlotList& rays) {
  const Instances* const instances = c_.media[m].instances();
  const auto anyone = [](size_t) { return true; };
  walk_grid(m, rays, w_.ray, w_.end, p_.flight, anyone, [&] {
    hits_.clear();
    passed_.clear();
    lanes_fly(scenes_[m], p_, inside_, hits_, passed_, counters_.lookups);
    for (const size_t i : hits_) {
      const auto number = instances ? static_cast<size_t>(visits_->instance[i]) : 0;
      const double unit = instances ? scenes_[m].unit / (*instances)[number].density : scenes_[m].unit;
      collide(i, std::min(w_.end[i], w_.begin[i] + static_cast<double>(p_.travel[i]) * unit), m, number);
    }
  });
  Replay* const flown = replays_[m].get();
  if (!flown) return;
  for (const size_t i : inside_) {
    flown->probability[i] = p_.flight_factor[i];
    flown->end[i] = w_.end[i];
  }
}

void MediaFlights::fly_in_double(size_t m, const SlotList& rays) {
  for (const size_t i : rays) {
    Collision collision;
    c_.media[m].at_time(w_.time[i]).each_met(w_.ray[i], w_.end[i], [&](const Medium& now, size_t instance) {
      collision = fly_one(now, i, w_.end[i]);
      if (collision.t >= 0) collide(i, collision.t, m, instance);
    });
    if (Replay* const replay = replays_[m].get()) {
      replay->probability[i] = vec3(collision.probability);
      replay->end[i] = w_.end[i];
    }
  }
}

Collision MediaFlights::fly_one(const Medium& now, size_t i, double end) {
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
    for (const size_t i : rays) probability[i] = vec3(fly_one(c_.media[m].at_time(w_.time[i]), i, end[i]).probability);
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

/// Each channel's probability density of passing a medium of closed form, up to a factor that all have.
dvec3 MediaFlights::density_in_shape(size_t m, size_t i, double end) const {
  const Medium& medium = c_.media[m];
  if (!medium.chromatic()) return dvec3(1);
  const Ray local = to_local(m, i, w_.ray[i]);
  const auto [t0, t1] = part_inside(bounds_[m], local, end);
  const dvec3 sigma = medium.coefficients().sigma_t;
  return t0 < t1 ? glm::exp((sigma[p_.hero[i]] - sigma) * bounds_[m].integral(local, t0, t1)) : dvec3(1);
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
    each_part_in_shape(
        m, i, w_.shadow[i], w_.shadow_end[i], [&](const Ray& local, double t0, double t1, double density, size_t) {
          dim(m, i, glm::exp(-c_.media[m].coefficients().sigma_t * density * bounds_[m].integral(local, t0, t1)));
        });
  }
}

void MediaFlights::shadow_in_lanes(size_t m, const SlotList& rays) {
  const auto lit = [&](size_t i) { return !dark(i); };
  walk_grid(m, rays, w_.shadow, w_.shadow_end, p_.shadow, lit,
            [&] { lanes_shadow(scenes_[m], p_, inside_, counters_.lookups); });
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
    m.each_met(ray, end, [&](const Medium& one, size_t) {
      if (product != dvec3(0)) product *= estimate_transmittance(one, one.to_local(ray), end, rng, counters_);
    });
  return product;
}

}  // namespace brume
