#include "render/transport/camera_rays.h"

#include <limits>

#include "render/transport/path_layers.h"
#include "volume/gradient.h"

namespace brume {

void CameraRays::start(int32_t slot, float begin) {
  b_.layers.covered[static_cast<size_t>(slot)] = 0.0f;
  b_.layers.begin[static_cast<size_t>(slot)] = begin;
}

void CameraRays::record_in_grid(const LaneScene& scene, const SlotList& fresh) {
  if (c_.plan.isosurface) find_in_grid(scene, fresh);
  if (c_.plan.marched()) march(scene, fresh);
}

void CameraRays::record_in_world(MediaFlights& flights, WorldPaths& world, const SlotList& fresh) {
  if (c_.plan.marched()) {
    for (size_t k = 0; k < fresh.count; ++k) {
      const PathRequest& request = request_of(fresh.slot[k]);
      record_camera_ray(c_, media_at(c_, request.time), request.ray, Rng(request.key), sample_of(fresh.slot[k]));
    }
    return;
  }
  if (!c_.plan.isosurface) return;
  // The nearest isosurface of all media counts.
  for (size_t k = 0; k < fresh.count; ++k)
    world.end[static_cast<size_t>(fresh.slot[k])] = std::numeric_limits<double>::infinity();
  for (size_t m = 0; m < c_.media.size(); ++m) {
    if (flights.in_lanes(m))
      find_in_world(flights, world, fresh, m);
    else
      for (size_t k = 0; k < fresh.count; ++k) find_one_by_one(world, fresh.slot[k], c_.media[m], 0);
  }
}

void CameraRays::write(size_t slot, PathSample& sample) const {
  const CameraRayLayers& l = b_.layers;
  if (c_.plan.isosurface && l.covered[slot] > 0)
    sample.coverage = 1, sample.gradient = {l.gx[slot], l.gy[slot], l.gz[slot]};
}

/// Sorts the rays that may meet the isosurface: into packets where their pixel is small enough, else one by one.
void CameraRays::sort(const SlotList& fresh) {
  b_.walks.count = b_.packed.count = 0;
  b_.packets.clear();
  uint32_t pixel = 0;
  for (size_t k = 0; k < fresh.count; ++k) {
    const int32_t slot = fresh.slot[k];
    if (b_.layers.begin[static_cast<size_t>(slot)] < 0) continue;
    const PathRequest& request = request_of(slot);
    if (request.start.axis < 0) {
      b_.walks.push(slot);
      continue;
    }
    if (b_.packets.empty() || request.key.pixel != pixel)
      b_.packets.push_back({b_.packed.count, b_.packed.count, request.start.axis, request.start.layer});
    pixel = request.key.pixel;
    b_.packed.push(slot);
    b_.packets.back().end = b_.packed.count;
  }
}

void CameraRays::find_in_grid(const LaneScene& scene, const SlotList& fresh) {
  sort(fresh);
  b_.crossings.slots.count = b_.crossings.unsure.count = 0;
  lanes_find_isosurface(scene, p_, b_.walks, b_.layers, b_.crossings);
  lanes_find_isosurface(scene, p_, b_.packed, b_.packets, b_.crossings);
  look_again(0);
  lanes_isosurface_points(scene, p_, b_.crossings, b_.points);
  lanes_gradient(scene, p_, b_.points);
  for (size_t k = 0; k < b_.points.slots.count; ++k)
    cover(static_cast<size_t>(b_.points.slots.slot[k]), gradient_at(k, 0));
}

/// Where camera rays meet a grid's isosurface before those of the media already looked at.
void CameraRays::find_in_world(MediaFlights& flights, WorldPaths& world, const SlotList& fresh, size_t m) {
  const LaneScene& scene = flights.scene(m);
  flights.enter(m, fresh, world.end, b_.walks);
  b_.crossings.slots.count = b_.crossings.unsure.count = 0;
  if (scene.displaced) {
    lanes_find_displaced_isosurface(scene, p_, b_.walks, b_.crossings);
  } else {
    for (size_t k = 0; k < b_.walks.count; ++k) b_.layers.begin[static_cast<size_t>(b_.walks.slot[k])] = 0;
    lanes_find_isosurface(scene, p_, b_.walks, b_.layers, b_.crossings);
    look_again(m);
  }
  const auto at = [&](size_t slot, float t) { return world.begin[slot] + static_cast<double>(t) * scene.unit; };
  if (c_.media[m].transform_moves()) {
    for (size_t k = 0; k < b_.crossings.slots.count; ++k) {
      const int32_t slot = b_.crossings.slots.slot[k];
      find_one_by_one(world, slot, c_.media[m], at(static_cast<size_t>(slot), b_.crossings.outside[k]));
    }
    return;
  }
  lanes_isosurface_points(scene, p_, b_.crossings, b_.points);
  lanes_gradient(scene, p_, b_.points);
  for (size_t k = 0; k < b_.points.slots.count; ++k) {
    const auto i = static_cast<size_t>(b_.points.slots.slot[k]);
    const double t = at(i, b_.crossings.inside[k]);
    if (!(t < world.end[i])) continue;
    world.end[i] = t;
    cover(i, gradient_at(k, m));
  }
}

/// @param begin  ray parameter before which the isosurface is not met
void CameraRays::find_one_by_one(WorldPaths& w, int32_t slot, const Medium& medium, double begin) {
  const auto i = static_cast<size_t>(slot);
  const Medium now = medium.at_time(w.time[i]);
  const Ray local = now.to_local(w.ray[i]);
  const auto t = find_isosurface(now, local, static_cast<float>(c_.isosurface_density * now.maximum_density()), begin);
  if (!t || !(*t < w.end[i])) return;
  w.end[i] = *t;
  PathSample sample;
  record_isosurface(now, local, *t, sample);
  cover(i, sample.gradient);
}

/// Rays that only came close to the isosurface are intersected exactly, so that coverage does not depend on where the
/// samples lie.
void CameraRays::look_again(size_t medium) {
  for (size_t k = 0; k < b_.crossings.unsure.count; ++k) {
    const int32_t slot = b_.crossings.unsure.slot[k];
    const auto i = static_cast<size_t>(slot);
    const Ray local{dvec3(p_.ox[i], p_.oy[i], p_.oz[i]), dvec3(p_.lx[i], p_.ly[i], p_.lz[i])};
    const float iso = c_.lane_grids[medium].isosurface_density;
    const auto t = find_isosurface(c_.media[medium], local, iso, b_.layers.begin[i]);
    if (!t) continue;
    const size_t n = b_.crossings.slots.count;
    b_.crossings.outside[n] = b_.crossings.inside[n] = static_cast<float>(*t);
    b_.crossings.below[n] = b_.crossings.above[n] = iso;
    b_.crossings.slots.push(slot);
  }
}

void CameraRays::march(const LaneScene& scene, const SlotList& fresh) {
  lanes_march(scene, p_, fresh, b_.layers);
  for (size_t k = 0; k < fresh.count; ++k)
    sample_of(fresh.slot[k]).optical_depth = static_cast<double>(b_.layers.depth[static_cast<size_t>(fresh.slot[k])]);
  if (!c_.plan.weighted_gradient) return;
  for (const auto& level : b_.layers.point) {
    b_.points.slots.count = 0;
    for (size_t k = 0; k < fresh.count; ++k) {
      const float t = level[static_cast<size_t>(fresh.slot[k])];
      if (t >= 0) add_point(fresh.slot[k], t);
    }
    lanes_gradient(scene, p_, b_.points);
    for (size_t k = 0; k < b_.points.slots.count; ++k)
      sample_of(b_.points.slots.slot[k]).gradient_transmittance_weighted +=
          gradient_at(k, 0) / static_cast<double>(kMarchedPoints);
  }
}

void CameraRays::cover(size_t slot, const dvec3& gradient) {
  b_.layers.covered[slot] = 1;
  b_.layers.gx[slot] = static_cast<float>(gradient.x);
  b_.layers.gy[slot] = static_cast<float>(gradient.y);
  b_.layers.gz[slot] = static_cast<float>(gradient.z);
}

void CameraRays::add_point(int32_t slot, float t) {
  const auto i = static_cast<size_t>(slot);
  const vec3 at = vec3(p_.ox[i], p_.oy[i], p_.oz[i]) + t * vec3(p_.lx[i], p_.ly[i], p_.lz[i]);
  const size_t k = b_.points.slots.count;
  b_.points.slots.push(slot);
  b_.points.x[k] = at.x;
  b_.points.y[k] = at.y;
  b_.points.z[k] = at.z;
}

dvec3 CameraRays::gradient_at(size_t k, size_t m) const {
  const GradientPoints& points = b_.points;
  const dvec3 g(points.gx[k], points.gy[k], points.gz[k]);
  if (g != dvec3(0)) return g;
  const Medium& medium = c_.media[m];
  const dvec3 p = dvec3(points.x[k], points.y[k], points.z[k]) - medium.walked_shift();
  const auto wide =
      density_gradient(medium.moves() ? medium.at_time(request_of(points.slots.slot[k]).time) : medium, p);
  return wide ? glm::normalize(*wide) : dvec3(0);
}

}  // namespace brume
