#include "render/lanes/wavefront.h"

#include <algorithm>
#include <array>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <tuple>
#include <vector>

#include "render/lanes/camera_layers.h"
#include "render/lanes/emission.h"
#include "render/lanes/flights.h"
#include "render/lanes/media_flights.h"
#include "render/lanes/ray_packet.h"
#include "render/lanes/scatter.h"
#include "render/lanes/surface_events.h"
#include "render/trace/path_layers.h"
#include "render/trace/rules.h"
#include "render/trace/volume_path.h"
#include "volume/gradient.h"
#include "volume/lane_grid.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();
/// Paths in flight where there are meshes, whose scalar work reads more of each path's state: that of fewer stays in
/// the cache. In kernels alone more paths keep lanes busier.
constexpr size_t kPoolAtSurfaces = kPool / 4;

/// The paths in flight on one thread.
class Wavefront {
 public:
  Wavefront(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
            PathCounters& counters)
      : c_(context), requests_(requests), sink_(sink), counters_(counters) {
    static thread_local State state;
    state_ = &state;
    if (keeps_samples()) state.samples.resize(kPool);
    for (size_t f = 0; f < c_.emissions.size(); ++f)
      glow_.emplace_back(c_.emissions[f], c_.emissions[f].shape().homogeneous() || c_.emissions[f].moves()
                                              ? nullptr
                                              : &c_.emission_grids[f]);
    if (!glow_.empty() && !state.glowing) state.glowing = std::make_unique<Glowing>();
    if (c_.plan.one_grid) {
      scene_ = lane_scene(c_, 0, nullptr);
      const auto [lo, hi] = c_.media[0].support();
      box_ = {HomogeneousShape::Shape::kBox, lo, hi};
      return;
    }
    if (!state.world) state.world = std::make_unique<WorldPaths>();
    flights_.emplace(c_, *state.world);
    if (c_.surfaces) surfaces_.emplace(c_, state.paths, *state.world, state.samples, counters_);
    for (const Medium& m : c_.media) spheres_.push_back(m.bounding_sphere());
  }

  void run() {
    State& s = *state_;
    s.active.count = 0;
    const size_t pool = surfaces_ ? kPoolAtSurfaces : kPool;
    free_.resize(pool);
    for (size_t i = 0; i < pool; ++i) free_[i] = static_cast<int32_t>(pool - 1 - i);
    counters_.tracking.stop = c_.stop;
    for (;;) {
      if (c_.stop != nullptr) c_.stop->check();
      for (SlotList* list : {&s.hits, &s.met, &s.escapes, &s.shadows, &s.alive, &s.beside}) list->count = 0;
      start_paths();
      if (s.active.count + s.hits.count + s.beside.count == 0) break;
      if (in_world())
        fly_in_world();
      else
        fly_in_grid();
      for (const LaneEmission& field : glow_) field.field.moves() ? add_moving_glow(field.field) : add_glow(field);
      for (size_t i = 0; i < s.escapes.count; ++i) escape(s.escapes.slot[i]);
      counters_.tracking.collisions += s.hits.count;
      if (c_.plan.first_event)
        for (size_t i = 0; i < s.hits.count; ++i)
          if (s.paths.events[static_cast<size_t>(s.hits.slot[i])] == 0) record_first(s.hits.slot[i]);
      if (in_world())
        scatter_in_world();
      else
        scatter_in_grid();
      add_light();
      retire();
    }
  }

 private:
  struct Glowing {
    struct Flight {
      Ray ray;     // in the world, the camera's from the eye on
      double end;  // on a light
    };
    std::array<Flight, kPool> flights;
    std::array<vec3, kPool> emission;  // along the camera ray
    EmissionSegments segments;
  };
  struct State {
    PathStates paths{};
    SlotList fresh, walks, packed, active, hits, met, escapes, shadows, alive;
    SurfaceCrossings crossings;
    GradientPoints points;
    CameraRayLayers camera;
    std::vector<RayPacket> packets;
    std::array<const FiniteLight*, kPool> end;  // the light that a flight ends on, where scene_.flights_end
    std::vector<PathSample> samples;            // of the paths, where keeps_samples()
    std::unique_ptr<Glowing> glowing;           // where something emits
    SlotList beside;                            // camera rays that miss the medium, but not what emits
    std::unique_ptr<WorldPaths> world;          // where in_world()
  };

  /// Whether layers are recorded that PathStates has no column for.
  bool keeps_samples() const { return c_.plan.marched() || c_.plan.first_event || c_.plan.first_surface; }

  /// Whether paths live in the world, not in the local coordinates of the one grid that there is.
  bool in_world() const { return flights_.has_value(); }
  bool chromatic() const { return c_.plan.media == Plan::Media::kChromatic; }

  /// Fills the free slots, and records what follows from the camera rays alone.
  void start_paths() {
    State& s = *state_;
    while (!free_.empty() && next_ < requests_.size()) {
      s.fresh.count = 0;
      while (!free_.empty() && next_ < requests_.size()) in_world() ? start_in_world(next_++) : start_in_grid(next_++);
      if (in_world()) {
        record_camera_rays_in_world();
      } else {
        if (c_.plan.medium_surface) record_surfaces();
        if (c_.plan.marched()) record_marches();
      }
      if (c_.plan.first_collision.forced) {
        fly_first();
        continue;
      }
      for (size_t k = 0; k < s.fresh.count; ++k) s.active.push(s.fresh.slot[k]);
    }
  }

  /// Starts a path in a free slot, its origin moved to where the ray can first enter the medium: near the medium,
  /// single precision is enough.
  void start_in_grid(size_t index) {
    const PathRequest& request = requests_[index];
    ++counters_.paths;
    Ray local{};
    double entry = request.start.medium, exit = 0;
    if (entry < EntryBound::kNever) {
      local = c_.media[0].to_local(request.ray);
      const auto [enters, leaves] = box_.intersect(local);
      entry = std::max(entry, enters);
      exit = leaves;
    }
    const bool meets = entry < exit;
    if (!meets && !may_glow(request.ray)) {
      PathSample sample;
      see_background(request.ray, dvec3(1), sample);
      deliver(index, sample);
      return;
    }
    const int32_t slot = take_slot(index);
    const dvec3 o = meets ? local.at(entry) : dvec3(0);
    PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    p.ox[i] = static_cast<float>(o.x);
    p.oy[i] = static_cast<float>(o.y);
    p.oz[i] = static_cast<float>(o.z);
    p.lx[i] = static_cast<float>(local.d.x * scene_.unit);
    p.ly[i] = static_cast<float>(local.d.y * scene_.unit);
    p.lz[i] = static_cast<float>(local.d.z * scene_.unit);
    const double ahead = request.start.surface;
    state_->camera.begin[i] = ahead < exit ? static_cast<float>(std::max(ahead - entry, 0.0) / scene_.unit) : -1.0f;
    (meets ? state_->fresh : state_->beside).push(slot);
  }

  /// Starts a path in a free slot at the eye.
  void start_in_world(size_t index) {
    const PathRequest& request = requests_[index];
    ++counters_.paths;
    if (!surfaces_ && !flights_->met_by(request.ray, request.time) && !may_glow(request.ray)) {
      PathSample sample;
      see_background(request.ray, dvec3(1), sample);
      deliver(index, sample);
      return;
    }
    const int32_t slot = take_slot(index);
    state_->world->ray[static_cast<size_t>(slot)] = request.ray;
    state_->world->time[static_cast<size_t>(slot)] = request.time;
    state_->paths.time[static_cast<size_t>(slot)] = static_cast<float>(request.time);
    flights_->place(static_cast<size_t>(slot), request.time);
    state_->world->past[static_cast<size_t>(slot)] = {};
    state_->world->surface[static_cast<size_t>(slot)] = vec3(0);
    state_->fresh.push(slot);
  }

  /// A free slot, set up for a request but for its place.
  int32_t take_slot(size_t index) {
    const PathRequest& request = requests_[index];
    const int32_t slot = free_.back();
    free_.pop_back();
    PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    p.dx[i] = static_cast<float>(request.ray.d.x);
    p.dy[i] = static_cast<float>(request.ray.d.y);
    p.dz[i] = static_cast<float>(request.ray.d.z);
    p.tr[i] = p.tg[i] = p.tb[i] = 1.0f;
    p.direct_r[i] = p.direct_g[i] = p.direct_b[i] = p.indirect_r[i] = p.indirect_g[i] = p.indirect_b[i] = 0.0f;
    p.passed[i] = 1.0f;
    state_->camera.covered[i] = 0.0f;
    if (keeps_samples()) state_->samples[i] = {};
    p.events[i] = 0;
    p.request[i] = static_cast<uint32_t>(index);
    const uint64_t seed = hash_combine(request.key.pixel_hash(), request.key.sample);
    const uint64_t a = mix64(seed), b = mix64(seed ^ 0xda3e39cb94b95bdbull) | 1u;  // never all zero
    p.s0[i] = static_cast<uint32_t>(a);
    p.s1[i] = static_cast<uint32_t>(a >> 32);
    p.s2[i] = static_cast<uint32_t>(b);
    p.s3[i] = static_cast<uint32_t>(b >> 32);
    if (!glow_.empty()) state_->glowing->emission[i] = vec3(0);
    if (chromatic()) {
      p.qr[i] = p.qg[i] = p.qb[i] = 1.0f;
      p.hero[i] = std::min(2, static_cast<int>(3 * PathGenerator(p, i).uniform()));
    }
    return slot;
  }

  /// Whether a camera ray passes through an emitting field.
  bool may_glow(const Ray& ray) const {
    return std::any_of(glow_.begin(), glow_.end(), [&](const LaneEmission& field) {
      if (field.field.moves()) return true;
      const auto [enters, leaves] = field.bounds.intersect(field.shape.to_local(ray));
      return std::max(enters, 0.0) < leaves;
    });
  }

  /// Sorts the camera rays that may hit the medium's surface: into packets where their pixel is small enough, else one
  /// by one.
  void sort_camera_rays() {
    State& s = *state_;
    s.walks.count = s.packed.count = 0;
    s.packets.clear();
    uint32_t pixel = 0;
    for (size_t k = 0; k < s.fresh.count; ++k) {
      const int32_t slot = s.fresh.slot[k];
      const auto i = static_cast<size_t>(slot);
      if (s.camera.begin[i] < 0) continue;
      const PathRequest& request = requests_[s.paths.request[i]];
      if (request.start.axis < 0) {
        s.walks.push(slot);
        continue;
      }
      if (s.packets.empty() || request.key.pixel != pixel)
        s.packets.push_back({s.packed.count, s.packed.count, request.start.axis, request.start.layer});
      pixel = request.key.pixel;
      s.packed.push(slot);
      s.packets.back().end = s.packed.count;
    }
  }

  /// Intersects the camera rays with the medium's surface, for coverage and gradient.
  void record_surfaces() {
    State& s = *state_;
    sort_camera_rays();
    s.crossings.slots.count = 0;
    s.crossings.unsure.count = 0;
    lanes_find_surface(scene_, s.paths, s.walks, s.camera, s.crossings);
    lanes_find_surface(scene_, s.paths, s.packed, s.packets, s.crossings);
    look_again(s.crossings, 0);
    lanes_surface_points(scene_, s.paths, s.crossings, s.points);
    lanes_gradient(scene_, s.points);
    for (size_t k = 0; k < s.points.slots.count; ++k) {
      const auto i = static_cast<size_t>(s.points.slots.slot[k]);
      cover(i, gradient_at(k, c_.media[0]));
    }
  }

  void cover(size_t slot, const dvec3& gradient) {
    CameraRayLayers& camera = state_->camera;
    camera.covered[slot] = 1;
    camera.gx[slot] = static_cast<float>(gradient.x);
    camera.gy[slot] = static_cast<float>(gradient.y);
    camera.gz[slot] = static_cast<float>(gradient.z);
  }

  /// Layers of the camera rays where there is more than one grid: the nearest isosurface of all media counts.
  void record_camera_rays_in_world() {
    State& s = *state_;
    if (c_.plan.marched()) {
      for (size_t k = 0; k < s.fresh.count; ++k) {
        const PathRequest& request = requests_[s.paths.request[static_cast<size_t>(s.fresh.slot[k])]];
        record_camera_ray(c_, media_at(request.time), request.ray, Rng(request.key), sample_of(s.fresh.slot[k]));
      }
    } else if (c_.plan.medium_surface) {
      for (size_t k = 0; k < s.fresh.count; ++k) s.world->end[static_cast<size_t>(s.fresh.slot[k])] = kFar;
      for (size_t m = 0; m < c_.media.size(); ++m) {
        if (c_.media[m].homogeneous() || c_.media[m].moves())
          record_one_by_one(m);
        else
          record_isosurface(m);
      }
    }
  }

  /// The media as they are at a time of the shutter.
  std::span<const Medium> media_at(double time) const {
    if (!c_.plan.moving_media) return c_.media;
    static thread_local std::vector<Medium> moved;
    moved.clear();
    for (const Medium& m : c_.media) moved.push_back(m.at_time(time));
    return moved;
  }

  /// The isosurfaces of media that move, and the boundaries of homogeneous ones.
  void record_one_by_one(size_t medium) {
    State& s = *state_;
    if (!flights_->scene(medium).displaced) {
      for (size_t k = 0; k < s.fresh.count; ++k) record_isosurface_of(s.fresh.slot[k], c_.media[medium], 0);
      return;
    }
    flights_->enter(medium, s.paths, *s.world, s.fresh, s.walks);
    s.crossings.slots.count = 0;
    lanes_find_displaced_surface(flights_->scene(medium), s.paths, s.walks, s.crossings);
    for (size_t k = 0; k < s.crossings.slots.count; ++k) {
      const double outside = static_cast<double>(s.crossings.outside[k]) * flights_->scene(medium).unit;
      const int32_t slot = s.crossings.slots.slot[k];
      record_isosurface_of(slot, c_.media[medium], s.world->begin[static_cast<size_t>(slot)] + outside);
    }
  }

  /// @param begin  ray parameter before which the isosurface is not met
  void record_isosurface_of(int32_t slot, const Medium& medium, double begin) {
    const auto i = static_cast<size_t>(slot);
    WorldPaths& w = *state_->world;
    const Medium now = medium.at_time(w.time[i]);
    const Ray local = now.to_local(w.ray[i]);
    const auto t = find_surface(now, local, static_cast<float>(c_.surface_density * now.maximum_density()), begin);
    if (!t || !(*t < w.end[i])) return;
    w.end[i] = *t;
    PathSample sample;
    record_medium_surface(now, local, *t, sample);
    cover(i, sample.gradient);
  }

  /// Where camera rays meet a grid's isosurface before those of the media already looked at.
  void record_isosurface(size_t medium) {
    State& s = *state_;
    const LaneScene& scene = flights_->scene(medium);
    flights_->enter(medium, s.paths, *s.world, s.fresh, s.walks);
    for (size_t k = 0; k < s.walks.count; ++k) s.camera.begin[static_cast<size_t>(s.walks.slot[k])] = 0;
    s.crossings.slots.count = s.crossings.unsure.count = 0;
    lanes_find_surface(scene, s.paths, s.walks, s.camera, s.crossings);
    look_again(s.crossings, medium);
    lanes_surface_points(scene, s.paths, s.crossings, s.points);
    lanes_gradient(scene, s.points);
    for (size_t k = 0; k < s.points.slots.count; ++k) {
      const auto i = static_cast<size_t>(s.points.slots.slot[k]);
      const double t = s.world->begin[i] + static_cast<double>(s.crossings.inside[k]) * scene.unit;
      if (!(t < s.world->end[i])) continue;
      s.world->end[i] = t;
      cover(i, gradient_at(k, c_.media[medium]));
    }
  }

  /// Rays that only came close to the surface are intersected exactly, so that coverage does not depend on where the
  /// samples lie.
  void look_again(SurfaceCrossings& crossings, size_t medium) const {
    const PathStates& p = state_->paths;
    for (size_t k = 0; k < crossings.unsure.count; ++k) {
      const int32_t slot = crossings.unsure.slot[k];
      const auto i = static_cast<size_t>(slot);
      const Ray local{dvec3(p.ox[i], p.oy[i], p.oz[i]), dvec3(p.lx[i], p.ly[i], p.lz[i])};
      const float iso = c_.lane_grids[medium].surface_density;
      const auto t = find_surface(c_.media[medium], local, iso, state_->camera.begin[i]);
      if (!t) continue;
      const size_t n = crossings.slots.count;
      crossings.outside[n] = crossings.inside[n] = static_cast<float>(*t);
      crossings.below[n] = crossings.above[n] = iso;
      crossings.slots.push(slot);
    }
  }

  /// Forced first collisions of the camera rays: the transmitted share sees the background, the rest goes on as paths.
  void fly_first() {
    State& s = *state_;
    find_ends(s.fresh);
    lanes_fly_first(scene_, s.paths, s.fresh, s.hits, s.escapes, counters_.tracking.lookups);
    for (size_t k = 0; k < s.escapes.count; ++k) escape(s.escapes.slot[k]);
    s.escapes.count = 0;
  }

  void record_marches() {
    State& s = *state_;
    lanes_march(scene_, s.paths, s.fresh, s.camera);
    for (size_t k = 0; k < s.fresh.count; ++k)
      sample_of(s.fresh.slot[k]).optical_depth =
          static_cast<double>(s.camera.depth[static_cast<size_t>(s.fresh.slot[k])]);
    if (!c_.plan.weighted_gradient) return;
    for (const auto& level : s.camera.point) {
      s.points.slots.count = 0;
      for (size_t k = 0; k < s.fresh.count; ++k) {
        const float t = level[static_cast<size_t>(s.fresh.slot[k])];
        if (t >= 0) add_point(s.fresh.slot[k], t);
      }
      lanes_gradient(scene_, s.points);
      for (size_t k = 0; k < s.points.slots.count; ++k)
        sample_of(s.points.slots.slot[k]).gradient_transmittance_weighted +=
            gradient_at(k, c_.media[0]) / static_cast<double>(kMarchedPoints);
    }
  }

  PathSample& sample_of(int32_t slot) { return state_->samples[static_cast<size_t>(slot)]; }

  void add_point(int32_t slot, float t) {
    GradientPoints& points = state_->points;
    const PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    const vec3 at = vec3(p.ox[i], p.oy[i], p.oz[i]) + t * local_direction(slot);
    const size_t k = points.slots.count;
    points.slots.push(slot);
    points.x[k] = at.x;
    points.y[k] = at.y;
    points.z[k] = at.z;
  }

  /// A path's current ray, in the world.
  Ray flight(int32_t slot) const {
    const PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    if (in_world()) return state_->world->ray[i];
    return {c_.media[0].to_world(dvec3(p.ox[i], p.oy[i], p.oz[i])), glm::normalize(dvec3(p.dx[i], p.dy[i], p.dz[i]))};
  }

  /// Finds the lights that flights end on, and keeps the flights themselves where emission is integrated along them. A
  /// light in front of the medium ends the camera ray where the medium begins.
  void find_ends(const SlotList& rays) {
    if (!scene_.flights_end && glow_.empty()) return;
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      const Ray ray = flight(rays.slot[k]);
      const bool camera = state_->paths.events[i] == 0;
      const Ray& whole = camera ? requests_[state_->paths.request[i]].ray : ray;
      double end = kFar;
      if (scene_.flights_end) {
        std::tie(state_->end[i], end) = c_.lights->nearest(whole, end, camera);
        const double reach = std::max(end - glm::dot(ray.o - whole.o, whole.d), 0.0);
        state_->paths.reach[i] = static_cast<float>(std::min(reach / scene_.unit, 1e30));
      }
      if (!glow_.empty()) state_->glowing->flights[i] = {whole, end};
    }
  }

  /// Free flights through the one grid.
  void fly_in_grid() {
    State& s = *state_;
    find_ends(s.active);
    find_ends(s.beside);
    lanes_fly(scene_, s.paths, s.active, s.hits, s.escapes, counters_.tracking.lookups);
    for (size_t i = 0; i < s.beside.count; ++i) s.escapes.push(s.beside.slot[i]);
    if (glow_.empty()) return;
    for (size_t k = 0; k < s.hits.count; ++k) {
      const auto i = static_cast<size_t>(s.hits.slot[k]);
      const Ray& whole = s.glowing->flights[i].ray;
      const dvec3 at = c_.media[0].to_world(dvec3(s.paths.ox[i], s.paths.oy[i], s.paths.oz[i]));
      s.glowing->flights[i].end = glm::dot(at - whole.o, whole.d);
    }
  }

  /// Free flights through all media, up to the nearest light or surface, and what they come to.
  void fly_in_world() {
    State& s = *state_;
    WorldPaths& w = *s.world;
    for (size_t k = 0; k < s.active.count; ++k) find_end_in_world(static_cast<size_t>(s.active.slot[k]));
    for (const NearLight& near : c_.plan.near_lights)
      for (size_t k = 0; k < s.active.count; ++k) gather_near(near, static_cast<size_t>(s.active.slot[k]));
    flights_->fly(s.paths, w, s.active, counters_.tracking);
    for (size_t k = 0; k < s.active.count; ++k) {
      const int32_t slot = s.active.slot[k];
      const auto i = static_cast<size_t>(slot);
      (w.medium[i] != WorldPaths::kNoMedium ? s.hits : w.on_surface[i] ? s.met : s.escapes).push(slot);
      if (!glow_.empty()) s.glowing->flights[i] = {w.ray[i], w.end[i]};
    }
  }

  /// The light or surface that a flight ends on at last.
  void find_end_in_world(size_t i) {
    WorldPaths& w = *state_->world;
    const PathStates& p = state_->paths;
    Ray& ray = w.ray[i];
    if (p.events[i] > 0) ray.d = glm::normalize(dvec3(p.dx[i], p.dy[i], p.dz[i]));
    w.end[i] = kFar;
    w.light[i] = nullptr;
    w.medium[i] = WorldPaths::kNoMedium;
    w.on_surface[i] = false;
    if (c_.plan.finite_lights) std::tie(w.light[i], w.end[i]) = c_.lights->nearest(ray, kFar, p.events[i] == 0);
    if (!surfaces_) return;
    if (const auto hit = c_.surfaces->intersect(ray, w.end[i])) {
      w.hit[i] = *hit;
      w.end[i] = hit->t;
      w.on_surface[i] = true;
    }
  }

  /// What far_share leaves out, of light scattered once along a flight: at a point chosen by its distance from the
  /// light.
  void gather_near(const NearLight& near, size_t i) {
    const Ray& ray = state_->world->ray[i];
    const double end = state_->world->end[i];
    double t0 = end, t1 = 0;
    for (const Medium::Sphere& ball : spheres_) {
      const double middle = glm::dot(ball.centre - ray.o, ray.d), off = glm::distance(ray.at(middle), ball.centre);
      if (!(off < ball.radius)) continue;
      const double half = std::sqrt(ball.radius * ball.radius - off * off);
      t0 = std::min(t0, std::max(0.0, middle - half));
      t1 = std::max(t1, std::min(end, middle + half));
    }
    if (!(t1 > t0)) return;
    const NearSegment segment(near, ray, t0, t1);
    PathGenerator numbers(state_->paths, i);
    if (!(numbers.uniform() < segment.worth())) return;
    const auto [t, pdf] = segment.sample(numbers.uniform());
    const dvec3 p = ray.at(t);
    const LightSample sample = near.light->sample(p, numbers.pair());
    if (!(sample.pdf > 0)) return;
    dvec3 scattered(0);
    const std::span<const Medium> media = media_at(state_->world->time[i]);
    for (const Medium& m : media) {
      const double density = m.density(m.to_local(p));
      counters_.tracking.look_up();
      if (density > 0)
        scattered += m.coefficients().sigma_t * (density * m.phase().value(glm::dot(ray.d, sample.wi))) * m.albedo(p);
    }
    dvec3 L = scattered * sample.radiance * ((1 - near.far_part(p)) / (pdf * segment.worth() * sample.pdf));
    const Ray shadow{p, sample.wi};
    if (L == dvec3(0) || c_.lights->blocked(shadow, sample.distance, near.light)) return;
    if (surfaces_) L *= c_.surfaces->passage(shadow, sample.distance * (1.0 - 1e-4)).light;
    if (L == dvec3(0)) return;
    Rng rng = numbers.stream();
    L *= flights_->transmittance(media, shadow, sample.distance, rng, counters_.tracking) *
         flights_->transmittance(media, ray, t, rng, counters_.tracking);
    const PathStates& paths = state_->paths;
    deposit(i, vec3(paths.tr[i], paths.tg[i], paths.tb[i]) * vec3(L), paths.events[i] + 1);
  }

  void scatter_in_grid() {
    State& s = *state_;
    lanes_scatter(scene_, s.paths, s.hits, s.shadows, s.alive, counters_.capped_paths, counters_.capped_throughput);
    lanes_shadow(scene_, s.paths, s.shadows, counters_.tracking.lookups);
  }

  /// The events at the ends of the flights, and the shadow rays of their light samples. Medium by medium: each has its
  /// phase function.
  void scatter_in_world() {
    State& s = *state_;
    WorldPaths& w = *s.world;
    for (size_t m = 0; m < flights_->count(); ++m) {
      s.walks.count = 0;
      for (size_t k = 0; k < s.hits.count; ++k) {
        const auto i = static_cast<size_t>(s.hits.slot[k]);
        if (w.medium[i] != static_cast<int32_t>(m)) continue;
        w.ray[i].o = w.ray[i].at(w.end[i]);
        w.past[i] = {.sampled_light = true, .first_on_surface = w.past[i].first_on_surface, .in_medium = true};
        s.walks.push(s.hits.slot[k]);
      }
      const LaneScene& scene = flights_->scene(m);
      const size_t first = s.shadows.count;
      lanes_scatter(scene, s.paths, s.walks, s.shadows, s.alive, counters_.capped_paths, counters_.capped_throughput);
      for (size_t k = first; k < s.shadows.count; ++k) {
        const auto i = static_cast<size_t>(s.shadows.slot[k]);
        w.shadow[i] = {w.ray[i].o, glm::normalize(dvec3(s.paths.sx[i], s.paths.sy[i], s.paths.sz[i]))};
        w.shadow_end[i] = scene.lights ? static_cast<double>(s.paths.shadow_reach[i]) * scene.unit : kFar;
      }
    }
    for (size_t k = 0; k < s.met.count; ++k) {
      const int32_t slot = s.met.slot[k];
      const PathRequest& request = requests_[s.paths.request[static_cast<size_t>(slot)]];
      if (surfaces_->meet(slot, request.ray.o, s.shadows)) s.alive.push(slot);
    }
    if (surfaces_) surfaces_->shadow(s.shadows);
    flights_->shadow(s.paths, w, s.shadows, counters_.tracking);
  }

  /// Goes on with the paths that are alive, and finishes the others.
  void retire() {
    State& s = *state_;
    for (size_t i = 0; i < s.alive.count; ++i) alive_[static_cast<size_t>(s.alive.slot[i])] = true;
    for (const SlotList* ended : {&s.hits, &s.met})
      for (size_t i = 0; i < ended->count; ++i) {
        const auto slot = static_cast<size_t>(ended->slot[i]);
        if (!alive_[slot]) finish(ended->slot[i]);
        alive_[slot] = false;
      }
    s.active = s.alive;
  }

  /// Adds what a field emits along the flights that have just ended. A flight passes a point with the probability of
  /// the transmittance to it, so no weight is needed. Scattering blurs: longer strata are enough after the first event.
  void add_glow(const LaneEmission& field) {
    State& s = *state_;
    PathStates& p = s.paths;
    EmissionSegments& segments = s.glowing->segments;
    s.walks.count = 0;
    for (const SlotList* ended : {&s.hits, &s.met, &s.escapes})
      for (size_t k = 0; k < ended->count; ++k) {
        const auto i = static_cast<size_t>(ended->slot[k]);
        const Glowing::Flight& flight = s.glowing->flights[i];
        const Ray local = field.shape.to_local(flight.ray);
        const auto [enters, leaves] = field.bounds.intersect(local);
        const double t0 = std::max(enters, 0.0), t1 = std::min(leaves, flight.end);
        if (!(t0 < t1)) continue;
        const vec3 o(local.at(t0)), d(local.d * field.unit);
        segments.ox[i] = o.x;
        segments.oy[i] = o.y;
        segments.oz[i] = o.z;
        segments.dx[i] = d.x;
        segments.dy[i] = d.y;
        segments.dz[i] = d.z;
        segments.end[i] = static_cast<float>((t1 - t0) / field.unit);
        segments.stride[i] = static_cast<float>(emission_stride(p.events[i]));
        s.walks.push(ended->slot[k]);
      }
    field.integrate(p, s.walks, segments);
    for (size_t k = 0; k < s.walks.count; ++k) {
      const auto i = static_cast<size_t>(s.walks.slot[k]);
      const vec3 glow = vec3(p.tr[i], p.tg[i], p.tb[i]) * vec3(segments.r[i], segments.g[i], segments.b[i]);
      if (p.events[i] == 0)
        s.glowing->emission[i] += glow;
      else
        deposit(i, glow, p.events[i]);
    }
  }

  /// The same for a field that moves over the shutter, path by path.
  void add_moving_glow(const EmissionField& field) {
    State& s = *state_;
    PathStates& p = s.paths;
    for (const SlotList* ended : {&s.hits, &s.met, &s.escapes})
      for (size_t k = 0; k < ended->count; ++k) {
        const auto i = static_cast<size_t>(ended->slot[k]);
        const Glowing::Flight& flight = s.glowing->flights[i];
        Rng rng = PathGenerator(p, i).stream();
        const dvec3 sum =
            field.integrate(flight.ray, 0, flight.end, emission_stride(p.events[i]), s.world->time[i], rng);
        const vec3 glow = vec3(p.tr[i], p.tg[i], p.tb[i]) * vec3(sum);
        if (p.events[i] == 0)
          s.glowing->emission[i] += glow;
        else
          deposit(i, glow, p.events[i]);
      }
  }

  vec3 local_direction(int32_t slot) const {
    const PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    return {p.lx[i], p.ly[i], p.lz[i]};
  }

  dvec3 gradient_at(size_t k, const Medium& medium) const {
    const GradientPoints& points = state_->points;
    const dvec3 g(points.gx[k], points.gy[k], points.gz[k]);
    if (g != dvec3(0)) return g;
    const auto wide = density_gradient(medium, dvec3(points.x[k], points.y[k], points.z[k]));
    return wide ? glm::normalize(*wide) : dvec3(0);
  }

  /// What a camera ray sees behind the medium, in full precision.
  void see_background(const Ray& ray, const dvec3& transmittance, PathSample& sample) const {
    sample.transmittance = transmittance;
    const auto [light, t] = c_.lights->nearest(ray, kFar, true);
    if (light) {
      sample.background = transmittance * light->radiance(ray, t);
      return;
    }
    for (const InfiniteLight* infinite : c_.lights->infinite())
      if (infinite->visible()) sample.background += transmittance * infinite->radiance(ray.d);
  }

  void deliver(size_t request, PathSample& s) const {
    s.direct = s.background + s.emission + s.single + s.surface;
    limit_indirect(c_.indirect_limit, s.indirect, counters_.limited);
    s.beauty = s.direct + s.indirect;
    if (c_.plan.flash) s.flash = flash_image(s.direct, c_.flash.intensity, s.flash);
    sink_(request, s);
  }

  /// Adds the light found by a path that has left the medium, or has hit a light.
  void escape(int32_t slot) {
    PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    const uint32_t events = p.events[i];
    if (events == 0) {
      finish(slot);
      return;
    }
    const Ray ray = flight(slot);
    const WorldPaths::Past past = in_world() ? state_->world->past[i] : WorldPaths::Past{.in_medium = true};
    const auto share = [&](const Light& light) {
      return c_.plan.light_sampling ? c_.lights->choice_probability(light, ray.o) : 0.0;
    };
    // Of light found by direction sampling; straight through glass, light sampling has found it.
    const auto weight = [&](double pdf_light) {
      if (past.straight && pdf_light > 0) return 0.0;
      return past.specular ? 1.0 : balance(static_cast<double>(p.pdf[i]), pdf_light);
    };
    dvec3 L(0);
    const FiniteLight* light = in_world() ? state_->world->light[i] : scene_.flights_end ? state_->end[i] : nullptr;
    if (light) {
      const double t = in_world() ? state_->world->end[i] : p.reach[i] * scene_.unit;
      L = light->radiance(ray, t) * weight(share(*light) * light->pdf(ray, t));
      if (past.in_medium) L *= far_share(c_.plan.near_lights, light, ray.o);
    } else {
      for (const InfiniteLight* infinite : c_.lights->infinite()) {
        const dvec3 radiance = infinite->radiance(ray.d);
        if (radiance == dvec3(0)) continue;
        const double probability = share(*infinite);
        L += radiance * weight(probability > 0 ? probability * infinite->pdf(ray.d) : 0.0);
      }
    }
    deposit(i, vec3(p.tr[i], p.tg[i], p.tb[i]) * vec3(L), events);
    finish(slot);
  }

  void record_first(int32_t slot) {
    const PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    const PathRequest& request = requests_[p.request[i]];
    PathSample& sample = sample_of(slot);
    const std::span<const Medium> media = media_at(request.time);
    const Medium& medium = media[in_world() ? static_cast<size_t>(state_->world->medium[i]) : 0];
    const dvec3 at = in_world() ? state_->world->ray[i].at(state_->world->end[i])
                                : medium.to_world(dvec3(p.ox[i], p.oy[i], p.oz[i]));
    sample.flash = record_first_scatter(c_, media, medium, request.ray.o, at, request.ray.d,
                                        dvec3(p.tr[i], p.tg[i], p.tb[i]), medium.albedo(at), sample);
  }

  /// Adds light found after `events` events. Scattered once it is direct (docs/methods.md, Direct and indirect light).
  void deposit(size_t i, const vec3& L, uint32_t events) {
    PathStates& p = state_->paths;
    const bool direct = is_direct(events);
    if (direct && in_world() && state_->world->past[i].first_on_surface) {
      state_->world->surface[i] += L;
      return;
    }
    (direct ? p.direct_r : p.indirect_r)[i] += L.x;
    (direct ? p.direct_g : p.indirect_g)[i] += L.y;
    (direct ? p.direct_b : p.indirect_b)[i] += L.z;
  }

  /// Adds the light samples, dimmed by the transmittance of their shadow rays.
  void add_light() {
    PathStates& p = state_->paths;
    for (size_t k = 0; k < state_->shadows.count; ++k) {
      const auto i = static_cast<size_t>(state_->shadows.slot[k]);
      vec3 L = vec3(p.cr[i], p.cg[i], p.cb[i]) * p.transmittance[i];
      if (chromatic()) L *= vec3(p.shadow_r[i], p.shadow_g[i], p.shadow_b[i]);
      if (in_world() && state_->world->past[i].to_catcher)
        state_->samples[i].catcher += dvec3(L);
      else
        deposit(i, L, p.events[i]);
    }
  }

  void finish(int32_t slot) {
    const PathStates& p = state_->paths;
    const CameraRayLayers& camera = state_->camera;
    const auto i = static_cast<size_t>(slot);
    PathSample s;
    if (keeps_samples()) s = sample_of(slot);
    const bool in_hole = in_world() && state_->world->past[i].in_hole;  // nothing is there, and alpha says so
    if (in_hole) s.transmittance = dvec3(p.tr[i], p.tg[i], p.tb[i]);
    if (in_world()) s.surface = dvec3(state_->world->surface[i]);
    if ((c_.plan.first_collision.forced || p.events[i] == 0) && !in_hole)
      see_background(requests_[p.request[i]].ray, chromatic() ? dvec3(p.tr[i], p.tg[i], p.tb[i]) : dvec3(p.passed[i]),
                     s);
    if (c_.plan.medium_surface && camera.covered[i] > 0)
      s.coverage = 1, s.gradient = {camera.gx[i], camera.gy[i], camera.gz[i]};
    if (!glow_.empty()) s.emission = dvec3(state_->glowing->emission[i]);
    s.single = {p.direct_r[i], p.direct_g[i], p.direct_b[i]};
    s.indirect = {p.indirect_r[i], p.indirect_g[i], p.indirect_b[i]};
    deliver(p.request[i], s);
    counters_.longest = std::max<uint64_t>(counters_.longest, p.events[i]);
    free_.push_back(slot);
  }

  const PathContext& c_;
  LaneScene scene_{};     // of the one grid, unless in_world()
  HomogeneousShape box_;  // around it
  std::optional<MediaFlights> flights_;
  std::optional<SurfaceEvents> surfaces_;
  std::vector<Medium::Sphere> spheres_;  // around the media
  std::span<const PathRequest> requests_;
  const SampleSink& sink_;
  PathCounters& counters_;
  State* state_;
  std::deque<LaneEmission> glow_;
  size_t next_ = 0;
  std::vector<int32_t> free_;
  std::array<bool, kPool> alive_{};
};

}  // namespace

void trace_paths_in_lanes(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
                          PathCounters& counters) {
  Wavefront(context, requests, sink, counters).run();
}

TracePaths select_path_tracer(const Plan& plan) {
  return plan.lanes ? trace_paths_in_lanes : select_general_loop(plan);
}

}  // namespace brume
