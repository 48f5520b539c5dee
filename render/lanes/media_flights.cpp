#include "render/lanes/media_flights.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "render/lanes/flights.h"
#include "volume/tracking.h"

namespace brume {
namespace {

/// The part of a local ray inside a shape, from 0 to `end`; empty (first >= second) where there is none.
std::pair<double, double> part_inside(const HomogeneousShape& shape, const Ray& local, double end) {
  const auto [enters, leaves] = shape.intersect(local);
  return {std::max(enters, 0.0), std::min(leaves, end)};
}

/// The same for the box of a grid, where the exit may lie outside: walks end there anyway.
std::pair<double, double> part_in_grid(const HomogeneousShape& box, const Ray& local, double end) {
  bool inside = true;
  for (int a = 0; a < 3; ++a) {
    const bool below = local.o[a]<box.lo[a], above = local.o[a]> box.hi[a];
    if ((below && !(local.d[a] > 0)) || (above && !(local.d[a] < 0))) return {1, 0};
    inside = inside && !below && !above;
  }
  if (inside) return {0, end};
  return part_inside(box, local, end);
}

/// Writes the part of a local ray between two parameters to columns, in the medium's unit.
struct LocalColumns {
  PathStates::Column<float>&dx, &dy, &dz, &length;
};

void put_local(PathStates& p, size_t i, const Ray& local, double t0, double t1, double unit, const LocalColumns& to) {
  const dvec3 o = local.at(t0), d = local.d * unit;
  p.ox[i] = static_cast<float>(o.x);
  p.oy[i] = static_cast<float>(o.y);
  p.oz[i] = static_cast<float>(o.z);
  to.dx[i] = static_cast<float>(d.x);
  to.dy[i] = static_cast<float>(d.y);
  to.dz[i] = static_cast<float>(d.z);
  to.length[i] = static_cast<float>(std::min((t1 - t0) / unit, 1e30));
}

}  // namespace

/// Flights through a chromatic grid: what each channel's probability of them is, and what is needed to fly them again
/// where another medium collides first.
struct MediaFlights::Flown {
  std::array<vec3, kPool> probability;
  std::array<double, kPool> end;                         ///< ray parameter up to which the probability counts
  std::array<std::array<uint32_t, 4>, kPool> generator;  ///< before the flight
};

MediaFlights::~MediaFlights() = default;

MediaFlights::MediaFlights(const PathContext& context, const WorldPaths& world) : c_(context) {
  for (size_t m = 0; m < c_.media.size(); ++m) {
    scenes_.push_back(lane_scene(context, m, &world));
    const Medium& medium = c_.media[m];
    flown_.push_back(medium.chromatic() && !medium.homogeneous() ? std::make_unique<Flown>() : nullptr);
    placed_.push_back(medium.transform_moves() ? std::make_unique<Placements>() : nullptr);
    const auto [lo, hi] = medium.support();
    bounds_.push_back(medium.homogeneous() ? *medium.homogeneous()
                                           : HomogeneousShape{HomogeneousShape::Shape::kBox, lo, hi});
  }
}

void MediaFlights::place(size_t slot, double time) {
  for (size_t m = 0; m < placed_.size(); ++m)
    if (placed_[m]) (*placed_[m])[slot] = c_.media[m].placement_at(time);
}

bool MediaFlights::met_by(const Ray& ray, double time) const {
  for (size_t m = 0; m < bounds_.size(); ++m) {
    const auto [enters, leaves] = bounds_[m].intersect(c_.media[m].placement_at(time).to_local(ray));
    if (std::max(enters, 0.0) < leaves) return true;
  }
  return false;
}

void MediaFlights::enter(size_t m, PathStates& paths, WorldPaths& world, const SlotList& rays, SlotList& inside) const {
  const Medium& medium = c_.media[m];
  inside.count = 0;
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    const Ray local = to_local(m, i, world.ray[i]);
    const auto [t0, t1] = part_in_grid(bounds_[m], local, world.end[i]);
    if (!(t0 < t1)) continue;
    world.begin[i] = t0;
    put_local(paths, i, {local.o + medium.walked_shift(), local.d}, t0, t1, scenes_[m].unit,
              {paths.lx, paths.ly, paths.lz, paths.reach});
    inside.push(rays.slot[k]);
  }
}

void MediaFlights::fly(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters) {
  for (size_t m = 0; m < c_.media.size(); ++m)
    if (c_.media[m].homogeneous())
      fly_through_shape(m, paths, world, rays);
    else
      fly_through_grid(m, paths, world, rays, counters);
  if (c_.plan.media != Plan::Media::kChromatic) return;
  for (size_t m = 0; m < c_.media.size(); ++m)
    if (flown_[m]) fly_again(m, paths, world, rays, counters);
  weigh_channels(paths, world, rays);
}

/// In closed form, by the extinction of the path's hero channel.
void MediaFlights::fly_through_shape(size_t m, PathStates& paths, WorldPaths& world, const SlotList& rays) const {
  const Medium& medium = c_.media[m];
  const bool chromatic = c_.plan.media == Plan::Media::kChromatic;
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    const auto [t0, t1] = part_inside(bounds_[m], to_local(m, i, world.ray[i]), world.end[i]);
    if (!(t0 < t1)) continue;
    const double sigma = medium.coefficients().sigma_t[chromatic ? paths.hero[i] : 0];
    const double t = t0 + PathGenerator(paths, i).exponential() / sigma;
    if (!(t < t1)) continue;
    world.end[i] = t;
    world.medium[i] = static_cast<int32_t>(m);
  }
}

void MediaFlights::fly_through_grid(size_t m, PathStates& paths, WorldPaths& world, const SlotList& rays,
                                    TrackingCounters& counters) {
  enter(m, paths, world, rays, inside_);
  Flown* const flown = flown_[m].get();
  if (flown) {
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      flown->probability[i] = vec3(1);
      flown->end[i] = 0;
      flown->generator[i] = {paths.s0[i], paths.s1[i], paths.s2[i], paths.s3[i]};
    }
  }
  hits_.count = escapes_.count = 0;
  lanes_fly(scenes_[m], paths, inside_, hits_, escapes_, counters.lookups);
  for (size_t k = 0; k < hits_.count; ++k) {
    const auto i = static_cast<size_t>(hits_.slot[k]);
    world.end[i] = std::min(world.end[i], world.begin[i] + static_cast<double>(paths.reach[i]) * scenes_[m].unit);
    world.medium[i] = static_cast<int32_t>(m);
  }
  if (!flown) return;
  for (size_t k = 0; k < inside_.count; ++k) {
    const auto i = static_cast<size_t>(inside_.slot[k]);
    flown->probability[i] = {paths.fr[i], paths.fg[i], paths.fb[i]};
    flown->end[i] = world.end[i];
  }
}

/// Where a flight went past the path's collision with another medium, only what lies before that counts: the same walk
/// again, up to there.
void MediaFlights::fly_again(size_t m, PathStates& paths, WorldPaths& world, const SlotList& rays,
                             TrackingCounters& counters) {
  Flown& flown = *flown_[m];
  SlotList& again = escapes_;
  again.count = 0;
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    if (world.end[i] < flown.end[i]) again.push(rays.slot[k]);
  }
  enter(m, paths, world, again, inside_);
  const auto swap_generators = [&] {
    for (size_t k = 0; k < again.count; ++k) {
      const auto i = static_cast<size_t>(again.slot[k]);
      std::array<uint32_t, 4>& kept = flown.generator[i];
      std::swap(paths.s0[i], kept[0]);
      std::swap(paths.s1[i], kept[1]);
      std::swap(paths.s2[i], kept[2]);
      std::swap(paths.s3[i], kept[3]);
    }
  };
  for (size_t k = 0; k < again.count; ++k) flown.probability[static_cast<size_t>(again.slot[k])] = vec3(1);
  swap_generators();
  hits_.count = passed_.count = 0;
  lanes_fly(scenes_[m], paths, inside_, hits_, passed_, counters.lookups);
  swap_generators();
  for (size_t k = 0; k < passed_.count; ++k) {
    const auto i = static_cast<size_t>(passed_.slot[k]);
    flown.probability[i] = {paths.fr[i], paths.fg[i], paths.fb[i]};
  }
}

/// The balance heuristic over the choice of the hero: throughput and densities are divided by the mean density.
void MediaFlights::weigh_channels(PathStates& p, const WorldPaths& world, const SlotList& rays) const {
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    dvec3 factor(1);
    for (size_t m = 0; m < c_.media.size(); ++m) {
      const Medium& medium = c_.media[m];
      if (!medium.chromatic()) continue;
      if (flown_[m]) {
        factor *= dvec3(flown_[m]->probability[i]);
        continue;
      }
      const auto [t0, t1] = part_inside(bounds_[m], to_local(m, i, world.ray[i]), world.end[i]);
      const dvec3 sigma = medium.coefficients().sigma_t;
      if (t0 < t1) factor *= glm::exp((sigma[p.hero[i]] - sigma) * (t1 - t0));
      if (world.medium[i] == static_cast<int32_t>(m)) factor *= medium.extinction_ratio();
    }
    const dvec3 density = dvec3(p.qr[i], p.qg[i], p.qb[i]) * factor;
    const double mean = (density.x + density.y + density.z) / 3;
    const dvec3 change = mean > 0 ? factor / mean : dvec3(0);
    p.tr[i] *= static_cast<float>(change.x);
    p.tg[i] *= static_cast<float>(change.y);
    p.tb[i] *= static_cast<float>(change.z);
    p.qr[i] *= static_cast<float>(change.x);
    p.qg[i] *= static_cast<float>(change.y);
    p.qb[i] *= static_cast<float>(change.z);
  }
}

void MediaFlights::shadow(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters) {
  const bool chromatic = c_.plan.media == Plan::Media::kChromatic;
  const auto dark = [&](size_t i) {
    return !(paths.transmittance[i] > 0) ||
           (chromatic && !(std::max({paths.shadow_r[i], paths.shadow_g[i], paths.shadow_b[i]}) > 0));
  };
  for (size_t k = 0; chromatic && k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    paths.shadow_r[i] = paths.shadow_g[i] = paths.shadow_b[i] = 1;
  }
  // What costs no look-up first: a ray that is dark already plays roulette at its first collision.
  for (size_t m = 0; m < c_.media.size(); ++m) {
    const Medium& medium = c_.media[m];
    if (!medium.homogeneous()) continue;
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      const auto [t0, t1] = part_inside(bounds_[m], to_local(m, i, world.shadow[i]), world.shadow_end[i]);
      if (!(t0 < t1)) continue;
      if (!medium.chromatic()) {
        paths.transmittance[i] *= static_cast<float>(std::exp(-medium.extinction_per_density() * (t1 - t0)));
        continue;
      }
      const dvec3 passes = glm::exp(-medium.coefficients().sigma_t * (t1 - t0));
      paths.shadow_r[i] *= static_cast<float>(passes.x);
      paths.shadow_g[i] *= static_cast<float>(passes.y);
      paths.shadow_b[i] *= static_cast<float>(passes.z);
    }
  }
  for (size_t m = 0; m < c_.media.size(); ++m) {
    const Medium& medium = c_.media[m];
    if (medium.homogeneous()) continue;
    inside_.count = 0;
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      if (dark(i)) continue;
      const Ray local = to_local(m, i, world.shadow[i]);
      const auto [t0, t1] = part_in_grid(bounds_[m], local, world.shadow_end[i]);
      if (!(t0 < t1)) continue;
      put_local(paths, i, {local.o + medium.walked_shift(), local.d}, t0, t1, scenes_[m].unit,
                {paths.sx, paths.sy, paths.sz, paths.shadow_reach});
      inside_.push(rays.slot[k]);
    }
    lanes_shadow(scenes_[m], paths, inside_, counters.lookups);
  }
}

dvec3 MediaFlights::transmittance(std::span<const Medium> media, const Ray& ray, double end, Rng& rng,
                                  TrackingCounters& counters) const {
  dvec3 product(1);
  for (const Medium& m : media) {
    if (product == dvec3(0)) break;
    if (m.chromatic())
      product *= estimate_chromatic_transmittance(m, m.to_local(ray), end, rng, counters);
    else
      product *= estimate_transmittance(m, m.to_local(ray), end, rng, counters);
  }
  return product;
}

}  // namespace brume
