#include "render/transport/camera_rays.h"

#include <algorithm>
#include <optional>

#include "render/transport/path_layers.h"
#include "volume/gradient.h"
#include "volume/tracking.h"

namespace brume {

void CameraRays::start(size_t slot, float begin) {
  b_.layers.covered[slot] = 0.0f;
  b_.layers.begin[slot] = begin;
}

void CameraRays::record(const SlotList& fresh) {
  const auto each_medium = [&](auto&& in_lanes, auto&& one_by_one) {
    for (const size_t i : fresh) w_.end[i] = kUnbounded;
    for (size_t m = 0; m < c_.media.size(); ++m) {
      if (c_.media[m].holdout()) continue;
      if (flights_.in_lanes(m) && !c_.media[m].instances()) {
        in_lanes(m);
        continue;
      }
      for (const size_t i : fresh)
        c_.media[m].each_met(w_.ray[i], kUnbounded, [&](const Medium& one, size_t) { one_by_one(i, one); });
    }
  };
  // The nearest isosurface of all media counts.
  if (c_.plan.isosurface)
    each_medium([&](size_t m) { find(fresh, m); }, [&](size_t i, const Medium& m) { find_one_by_one(i, m); });
  if (!c_.plan.marched()) return;
  each_medium([&](size_t m) { march(fresh, m); }, [&](size_t i, const Medium& m) { march_one_by_one(i, m); });
  for (const size_t i : fresh) samples_[i].optical_depth = std::min(samples_[i].optical_depth, kDeepest);
}

void CameraRays::write(size_t slot, PathSample& sample) const {
  const CameraRayLayers& l = b_.layers;
  if (c_.plan.isosurface && l.covered[slot] > 0) sample.coverage = 1, sample.gradient = dvec3(l.gradient[slot]);
}

/// Sorts the rays that may meet the isosurface: into packets where their pixel is small enough, else one by one.
void CameraRays::sort(const SlotList& fresh) {
  b_.packed.clear();
  b_.packets.clear();
  uint32_t pixel = 0;
  for (const size_t i : fresh) {
    if (b_.layers.begin[i] < 0) continue;
    const PathRequest& request = request_of(i);
    if (request.start.axis < 0) {
      b_.walks.push(i);
      continue;
    }
    if (b_.packets.empty() || request.key.pixel != pixel)
      b_.packets.push_back({b_.packed.count, b_.packed.count, request.start.axis, request.start.layer});
    pixel = request.key.pixel;
    b_.packed.push(i);
    b_.packets.back().end = b_.packed.count;
  }
}

/// Where camera rays meet a grid's isosurface before those of the media already looked at.
void CameraRays::find(const SlotList& fresh, size_t m) {
  const LaneScene& scene = flights_.scene(m);
  b_.walks.clear();
  b_.crossings.slots.clear();
  b_.crossings.unsure.clear();
  if (c_.plan.one_grid) {
    sort(fresh);
    lanes_find_isosurface(scene, p_, b_.packed, b_.packets, b_.crossings);
  } else {
    flights_.enter(m, fresh, w_.end, b_.walks);
  }
  if (scene.displaced)
    lanes_find_displaced_isosurface(scene, p_, b_.walks, b_.crossings);
  else
    lanes_find_isosurface(scene, p_, b_.walks, b_.layers, b_.crossings);
  look_again(m);
  const auto at = [&](size_t slot, float t) { return w_.begin[slot] + static_cast<double>(t) * scene.unit; };
  lanes_isosurface_points(scene, p_, b_.crossings, b_.points);
  lanes_gradient(scene, p_, b_.points);
  for (size_t k = 0; k < b_.points.slots.count; ++k) {
    const size_t i = b_.points.slots[k];
    const double t = at(i, b_.crossings.inside[k]);
    if (!(t < w_.end[i])) continue;
    w_.end[i] = t;
    cover(i, gradient_at(k, m));
  }
}

/// The same of a medium whose grid is walked in double precision.
void CameraRays::find_one_by_one(size_t i, const Medium& medium) {
  const Medium now = medium.at_time(w_.time[i]);
  const Ray local = now.to_local(w_.ray[i]);
  const auto t = find_isosurface(now, local, static_cast<float>(c_.isosurface_density * now.maximum_density()));
  if (!t || !(*t < w_.end[i])) return;
  w_.end[i] = *t;
  cover(i, isosurface_gradient(now, local, *t).value_or(dvec3(0)));
}

/// Rays that only came close to the isosurface are intersected exactly, so that coverage does not depend on where the
/// samples lie.
void CameraRays::look_again(size_t medium) {
  for (const size_t i : b_.crossings.unsure) {
    const Ray local{dvec3(p_.flight.o[i]), dvec3(p_.flight.d[i])};
    const float iso = c_.lane_grids[medium].isosurface_density;
    const auto t = find_isosurface(c_.media[medium], local, iso, b_.layers.begin[i]);
    if (t) b_.crossings.add(i, static_cast<float>(*t), static_cast<float>(*t), iso, iso);
  }
}

/// Optical depth, and the gradient weighted by transmittance, of one medium: overlaps are weighted as if the others
/// were not there.
void CameraRays::march(const SlotList& fresh, size_t m) {
  if (!c_.plan.one_grid) flights_.enter(m, fresh, w_.end, b_.walks);
  const SlotList& rays = c_.plan.one_grid ? fresh : b_.walks;
  lanes_march(flights_.scene(m), p_, rays, b_.layers);
  for (const size_t i : rays) samples_[i].optical_depth += static_cast<double>(b_.layers.depth[i]);
  if (!c_.plan.weighted_gradient) return;
  for (const Column<float>& level : b_.layers.point) {
    b_.points.slots.clear();
    for (const size_t i : rays)
      if (level[i] >= 0) add_point(i, level[i]);
    lanes_gradient(flights_.scene(m), p_, b_.points);
    for (size_t k = 0; k < b_.points.slots.count; ++k)
      samples_[b_.points.slots[k]].gradient_transmittance_weighted +=
          gradient_at(k, m) / static_cast<double>(kMarchedPoints);
  }
}

/// The same of a medium that has no lanes: first collisions are distributed as the weights are.
void CameraRays::march_one_by_one(size_t i, const Medium& medium) {
  const Medium now = medium.at_time(w_.time[i]);
  const Ray local = now.to_local(w_.ray[i]);
  samples_[i].optical_depth += optical_depth(now, local, kUnbounded);
  if (!c_.plan.weighted_gradient || now.homogeneous()) return;  // no gradient inside
  Rng rng(request_of(i).key);
  TrackingCounters uncounted;
  for (size_t k = 0; k < kMarchedPoints; ++k) {
    const double t = sample_collision(now, local, kUnbounded, 0, rng, uncounted).t;
    const auto gradient = t < 0 ? std::nullopt : density_gradient(now, local.at(t));
    if (gradient)
      samples_[i].gradient_transmittance_weighted += glm::normalize(*gradient) / static_cast<double>(kMarchedPoints);
  }
}

void CameraRays::cover(size_t slot, const dvec3& gradient) {
  b_.layers.covered[slot] = 1;
  b_.layers.gradient.set(slot, vec3(gradient));
}

void CameraRays::add_point(size_t slot, float t) {
  const size_t k = b_.points.slots.count;
  b_.points.slots.push(slot);
  b_.points.p.set(k, p_.flight.o[slot] + t * p_.flight.d[slot]);
}

/// By density_gradient where that of lanes is too small to tell, or is for another place of the medium.
dvec3 CameraRays::gradient_at(size_t k, size_t m) const {
  const Medium& medium = c_.media[m];
  const dvec3 g(b_.points.gradient[k]);
  if (g != dvec3(0) && !medium.transform_moves()) return g;
  const dvec3 p = dvec3(b_.points.p[k]) - medium.walked_shift();
  const auto wide = density_gradient(medium.moves() ? medium.at_time(request_of(b_.points.slots[k]).time) : medium, p);
  return wide ? glm::normalize(*wide) : dvec3(0);
}

}  // namespace brume
