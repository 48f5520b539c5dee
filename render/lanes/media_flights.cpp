#include "render/lanes/media_flights.h"

#include <algorithm>
#include <cmath>

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
    const bool below = local.o[a] < box.lo[a], above = local.o[a] > box.hi[a];
    if ((below && !(local.d[a] > 0)) || (above && !(local.d[a] < 0))) return {1, 0};
    inside = inside && !below && !above;
  }
  if (inside) return {0, end};
  return part_inside(box, local, end);
}

}  // namespace

MediaFlights::MediaFlights(const PathContext& context, const WorldPaths& world) : c_(context) {
  for (size_t m = 0; m < c_.media.size(); ++m) {
    scenes_.push_back(lane_scene(context, m, &world));
    const Medium& medium = c_.media[m];
    const auto [lo, hi] = medium.support();
    bounds_.push_back(medium.homogeneous() ? *medium.homogeneous()
                                           : HomogeneousShape{HomogeneousShape::Shape::kBox, lo, hi});
  }
}

bool MediaFlights::met_by(const Ray& ray) const {
  for (size_t m = 0; m < bounds_.size(); ++m) {
    const auto [enters, leaves] = bounds_[m].intersect(c_.media[m].to_local(ray));
    if (std::max(enters, 0.0) < leaves) return true;
  }
  return false;
}

/// Writes the part of a local ray between two parameters to columns, in the medium's unit.
struct LocalColumns {
  PathStates::Column<float>&dx, &dy, &dz, &length;
};

static void put_local(PathStates& p, size_t i, const Ray& local, double t0, double t1, double unit,
                      const LocalColumns& to) {
  const dvec3 o = local.at(t0), d = local.d * unit;
  p.ox[i] = static_cast<float>(o.x);
  p.oy[i] = static_cast<float>(o.y);
  p.oz[i] = static_cast<float>(o.z);
  to.dx[i] = static_cast<float>(d.x);
  to.dy[i] = static_cast<float>(d.y);
  to.dz[i] = static_cast<float>(d.z);
  to.length[i] = static_cast<float>(std::min((t1 - t0) / unit, 1e30));
}

void MediaFlights::enter(size_t m, PathStates& paths, WorldPaths& world, const SlotList& rays, SlotList& inside) const {
  const Medium& medium = c_.media[m];
  inside.count = 0;
  for (size_t k = 0; k < rays.count; ++k) {
    const auto i = static_cast<size_t>(rays.slot[k]);
    const Ray local = medium.to_local(world.ray[i]);
    const auto [t0, t1] = part_in_grid(bounds_[m], local, world.end[i]);
    if (!(t0 < t1)) continue;
    world.begin[i] = t0;
    put_local(paths, i, local, t0, t1, scenes_[m].unit, {paths.lx, paths.ly, paths.lz, paths.reach});
    inside.push(rays.slot[k]);
  }
}

void MediaFlights::fly(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters) {
  for (size_t m = 0; m < c_.media.size(); ++m) {
    const Medium& medium = c_.media[m];
    const auto number = static_cast<int32_t>(m);
    if (medium.homogeneous()) {
      for (size_t k = 0; k < rays.count; ++k) {
        const auto i = static_cast<size_t>(rays.slot[k]);
        const auto [t0, t1] = part_inside(bounds_[m], medium.to_local(world.ray[i]), world.end[i]);
        if (!(t0 < t1)) continue;
        const double t = t0 + PathGenerator(paths, i).exponential() / medium.extinction_per_density();
        if (!(t < t1)) continue;
        world.end[i] = t;
        world.medium[i] = number;
      }
      continue;
    }
    enter(m, paths, world, rays, inside_);
    hits_.count = escapes_.count = 0;
    lanes_fly(scenes_[m], paths, inside_, hits_, escapes_, counters.lookups);
    for (size_t k = 0; k < hits_.count; ++k) {
      const auto i = static_cast<size_t>(hits_.slot[k]);
      world.end[i] = std::min(world.end[i], world.begin[i] + static_cast<double>(paths.reach[i]) * scenes_[m].unit);
      world.medium[i] = number;
    }
  }
}

void MediaFlights::shadow(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters) {
  // What costs no look-up first: a ray that is dark already plays roulette at its first collision.
  for (size_t m = 0; m < c_.media.size(); ++m) {
    const Medium& medium = c_.media[m];
    if (!medium.homogeneous()) continue;
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      const auto [t0, t1] = part_inside(bounds_[m], medium.to_local(world.shadow[i]), world.shadow_end[i]);
      if (t0 < t1) paths.transmittance[i] *= static_cast<float>(std::exp(-medium.extinction_per_density() * (t1 - t0)));
    }
  }
  for (size_t m = 0; m < c_.media.size(); ++m) {
    const Medium& medium = c_.media[m];
    if (medium.homogeneous()) continue;
    inside_.count = 0;
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      if (!(paths.transmittance[i] > 0)) continue;
      const Ray local = medium.to_local(world.shadow[i]);
      const auto [t0, t1] = part_in_grid(bounds_[m], local, world.shadow_end[i]);
      if (!(t0 < t1)) continue;
      put_local(paths, i, local, t0, t1, scenes_[m].unit, {paths.sx, paths.sy, paths.sz, paths.shadow_reach});
      inside_.push(rays.slot[k]);
    }
    lanes_shadow(scenes_[m], paths, inside_, counters.lookups);
  }
}

double MediaFlights::transmittance(const Ray& ray, double end, Rng& rng, TrackingCounters& counters) const {
  double product = 1;
  for (const Medium& m : c_.media)
    if (product > 0) product *= estimate_transmittance(m, m.to_local(ray), end, rng, counters);
  return product;
}

}  // namespace brume
