#include "render/lanes/wavefront.h"

#include <algorithm>
#include <array>
#include <deque>
#include <limits>
#include <memory>
#include <tuple>
#include <vector>

#include "render/lanes/camera_layers.h"
#include "render/lanes/emission.h"
#include "render/lanes/flights.h"
#include "render/lanes/ray_packet.h"
#include "render/lanes/scatter.h"
#include "render/trace/path_layers.h"
#include "render/trace/rules.h"
#include "render/trace/volume_path.h"
#include "volume/gradient.h"
#include "volume/lane_grid.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

/// The paths in flight on one thread.
class Wavefront {
 public:
  Wavefront(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
            PathCounters& counters)
      : c_(context),
        scene_(lane_scene(context)),
        box_{HomogeneousShape::Shape::kBox, context.media[0].support().first, context.media[0].support().second},
        requests_(requests),
        sink_(sink),
        counters_(counters) {
    static thread_local State state;
    state_ = &state;
    if (keeps_samples()) state.samples.resize(kPool);
    for (size_t f = 0; f < c_.emissions.size(); ++f) glow_.emplace_back(c_.emissions[f], c_.emission_grids[f]);
    if (!glow_.empty() && !state.glowing) state.glowing = std::make_unique<Glowing>();
  }

  void run() {
    State& s = *state_;
    s.active.count = 0;
    free_.resize(kPool);
    for (size_t i = 0; i < kPool; ++i) free_[i] = static_cast<int32_t>(kPool - 1 - i);
    TrackingCounters& tracking = counters_.tracking;
    for (;;) {
      if (c_.stop != nullptr) c_.stop->check();
      s.hits.count = s.escapes.count = s.shadows.count = s.alive.count = s.beside.count = 0;
      start_paths();
      if (s.active.count + s.hits.count + s.beside.count == 0) break;
      find_ends(s.active);
      find_ends(s.beside);
      lanes_fly(scene_, s.paths, s.active, s.hits, s.escapes, tracking.lookups);
      for (size_t i = 0; i < s.beside.count; ++i) s.escapes.push(s.beside.slot[i]);
      for (const LaneEmission& field : glow_) add_glow(field);
      for (size_t i = 0; i < s.escapes.count; ++i) escape(s.escapes.slot[i]);
      tracking.collisions += s.hits.count;
      if (c_.plan.first_event)
        for (size_t i = 0; i < s.hits.count; ++i)
          if (s.paths.events[static_cast<size_t>(s.hits.slot[i])] == 0) record_first(s.hits.slot[i]);
      lanes_scatter(scene_, s.paths, s.hits, s.shadows, s.alive, counters_.capped_paths, counters_.capped_throughput);
      lanes_shadow(scene_, s.paths, s.shadows, tracking.lookups);
      add_light();
      for (size_t i = 0; i < s.alive.count; ++i) alive_[static_cast<size_t>(s.alive.slot[i])] = true;
      for (size_t i = 0; i < s.hits.count; ++i) {
        const auto slot = static_cast<size_t>(s.hits.slot[i]);
        if (!alive_[slot]) finish(s.hits.slot[i]);
        alive_[slot] = false;
      }
      s.active = s.alive;
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
    SlotList fresh, walks, packed, active, hits, escapes, shadows, alive;
    SurfaceCrossings crossings;
    GradientPoints points;
    CameraRayLayers camera;
    std::vector<RayPacket> packets;
    std::array<const FiniteLight*, kPool> end;  // the light that a flight ends on, where scene_.flights_end
    std::vector<PathSample> samples;            // of the paths, where keeps_samples()
    std::unique_ptr<Glowing> glowing;           // where something emits
    SlotList beside;                            // camera rays that miss the medium, but not what emits
  };

  /// Whether layers are recorded that PathStates has no column for.
  bool keeps_samples() const { return c_.plan.marched() || c_.plan.first_event; }

  /// Fills the free slots, and records what follows from the camera rays alone.
  void start_paths() {
    State& s = *state_;
    while (!free_.empty() && next_ < requests_.size()) {
      s.fresh.count = 0;
      while (!free_.empty() && next_ < requests_.size()) start(next_++);
      if (c_.plan.medium_surface) record_surfaces();
      if (c_.plan.marched()) record_marches();
      if (c_.plan.first_collision.forced) {
        fly_first();
        continue;
      }
      for (size_t k = 0; k < s.fresh.count; ++k) s.active.push(s.fresh.slot[k]);
    }
  }

  /// Starts a path in a free slot, its origin moved to where the ray can first enter the medium: near the medium,
  /// single precision is enough.
  void start(size_t index) {
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
      see_background(request.ray, 1, sample);
      deliver(index, sample);
      return;
    }
    const int32_t slot = free_.back();
    free_.pop_back();
    const dvec3 o = meets ? local.at(entry) : dvec3(0);
    PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    p.ox[i] = static_cast<float>(o.x);
    p.oy[i] = static_cast<float>(o.y);
    p.oz[i] = static_cast<float>(o.z);
    p.lx[i] = static_cast<float>(local.d.x * scene_.unit);
    p.ly[i] = static_cast<float>(local.d.y * scene_.unit);
    p.lz[i] = static_cast<float>(local.d.z * scene_.unit);
    p.dx[i] = static_cast<float>(request.ray.d.x);
    p.dy[i] = static_cast<float>(request.ray.d.y);
    p.dz[i] = static_cast<float>(request.ray.d.z);
    p.tr[i] = p.tg[i] = p.tb[i] = 1.0f;
    p.direct_r[i] = p.direct_g[i] = p.direct_b[i] = p.indirect_r[i] = p.indirect_g[i] = p.indirect_b[i] = 0.0f;
    p.passed[i] = 1.0f;
    state_->camera.covered[i] = 0.0f;
    const double ahead = request.start.surface;
    state_->camera.begin[i] = ahead < exit ? static_cast<float>(std::max(ahead - entry, 0.0) / scene_.unit) : -1.0f;
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
    (meets ? state_->fresh : state_->beside).push(slot);
  }

  /// Whether a camera ray passes through an emitting field.
  bool may_glow(const Ray& ray) const {
    return std::any_of(glow_.begin(), glow_.end(), [&](const LaneEmission& field) {
      const auto [enters, leaves] = field.box.intersect(field.shape.to_local(ray));
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
    look_again(s.crossings);
    lanes_surface_points(scene_, s.paths, s.crossings, s.points);
    lanes_gradient(scene_, s.points);
    for (size_t k = 0; k < s.points.slots.count; ++k) {
      const auto i = static_cast<size_t>(s.points.slots.slot[k]);
      const vec3 g(gradient_at(k));
      s.camera.covered[i] = 1;
      s.camera.gx[i] = g.x;
      s.camera.gy[i] = g.y;
      s.camera.gz[i] = g.z;
    }
  }

  /// Rays that only came close to the surface are intersected exactly, so that coverage does not depend on where the
  /// samples lie.
  void look_again(SurfaceCrossings& crossings) const {
    const PathStates& p = state_->paths;
    for (size_t k = 0; k < crossings.unsure.count; ++k) {
      const int32_t slot = crossings.unsure.slot[k];
      const auto i = static_cast<size_t>(slot);
      const Ray local{dvec3(p.ox[i], p.oy[i], p.oz[i]), dvec3(p.lx[i], p.ly[i], p.lz[i])};
      const auto t = find_surface(c_.media[0], local, scene_.surface_density, state_->camera.begin[i]);
      if (!t) continue;
      const size_t n = crossings.slots.count;
      crossings.outside[n] = crossings.inside[n] = static_cast<float>(*t);
      crossings.below[n] = crossings.above[n] = scene_.surface_density;
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
            gradient_at(k) / static_cast<double>(kMarchedPoints);
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

  /// Adds what a field emits along the flights that have just ended. A flight passes a point with the probability of
  /// the transmittance to it, so no weight is needed. Scattering blurs: longer strata are enough after the first event.
  void add_glow(const LaneEmission& field) {
    State& s = *state_;
    PathStates& p = s.paths;
    EmissionSegments& segments = s.glowing->segments;
    const auto& flights = s.glowing->flights;
    s.walks.count = 0;
    const auto add = [&](int32_t slot, double end) {
      const auto i = static_cast<size_t>(slot);
      const Ray local = field.shape.to_local(flights[i].ray);
      const auto [enters, leaves] = field.box.intersect(local);
      const double t0 = std::max(enters, 0.0), t1 = std::min(leaves, end);
      if (!(t0 < t1)) return;
      const vec3 o(local.at(t0)), d(local.d * field.unit);
      segments.ox[i] = o.x;
      segments.oy[i] = o.y;
      segments.oz[i] = o.z;
      segments.dx[i] = d.x;
      segments.dy[i] = d.y;
      segments.dz[i] = d.z;
      segments.end[i] = static_cast<float>((t1 - t0) / field.unit);
      segments.stride[i] = static_cast<float>(emission_stride(p.events[i]));
      s.walks.push(slot);
    };
    for (size_t k = 0; k < s.hits.count; ++k) {
      const auto i = static_cast<size_t>(s.hits.slot[k]);
      const Ray& whole = flights[i].ray;
      add(s.hits.slot[k], glm::dot(c_.media[0].to_world(dvec3(p.ox[i], p.oy[i], p.oz[i])) - whole.o, whole.d));
    }
    for (size_t k = 0; k < s.escapes.count; ++k)
      add(s.escapes.slot[k], flights[static_cast<size_t>(s.escapes.slot[k])].end);
    lanes_emission(field.cells, p, s.walks, segments);
    for (size_t k = 0; k < s.walks.count; ++k) {
      const auto i = static_cast<size_t>(s.walks.slot[k]);
      const vec3 glow = vec3(p.tr[i], p.tg[i], p.tb[i]) * vec3(segments.r[i], segments.g[i], segments.b[i]);
      if (p.events[i] == 0)
        s.glowing->emission[i] += glow;
      else
        deposit(i, glow);
    }
  }

  vec3 local_direction(int32_t slot) const {
    const PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    return {p.lx[i], p.ly[i], p.lz[i]};
  }

  dvec3 gradient_at(size_t k) const {
    const GradientPoints& points = state_->points;
    const dvec3 g(points.gx[k], points.gy[k], points.gz[k]);
    if (g != dvec3(0)) return g;
    const auto wide = density_gradient(c_.media[0], dvec3(points.x[k], points.y[k], points.z[k]));
    return wide ? glm::normalize(*wide) : dvec3(0);
  }

  /// What a camera ray sees behind the medium, in full precision.
  void see_background(const Ray& ray, double transmittance, PathSample& sample) const {
    sample.transmittance = dvec3(transmittance);
    const auto [light, t] = c_.lights->nearest(ray, kFar, true);
    if (light) {
      sample.background = transmittance * light->radiance(ray, t);
      return;
    }
    for (const InfiniteLight* infinite : c_.lights->infinite())
      if (infinite->visible()) sample.background += transmittance * infinite->radiance(ray.d);
  }

  void deliver(size_t request, PathSample& s) const {
    s.direct = s.background + s.emission + s.single;
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
    const auto share = [&](const Light& light) {
      return c_.plan.light_sampling ? c_.lights->choice_probability(light, ray.o) : 0.0;
    };
    const auto weight = [pdf = static_cast<double>(p.pdf[i])](double light) { return balance(pdf, light); };
    dvec3 L(0);
    if (const FiniteLight* light = scene_.flights_end ? state_->end[i] : nullptr) {
      const double t = p.reach[i] * scene_.unit;
      L = light->radiance(ray, t) * weight(share(*light) * light->pdf(ray, t));
    } else {
      for (const InfiniteLight* infinite : c_.lights->infinite()) {
        const dvec3 radiance = infinite->radiance(ray.d);
        if (radiance == dvec3(0)) continue;
        const double probability = share(*infinite);
        L += radiance * weight(probability > 0 ? probability * infinite->pdf(ray.d) : 0.0);
      }
    }
    deposit(i, vec3(p.tr[i], p.tg[i], p.tb[i]) * vec3(L));
    finish(slot);
  }

  void record_first(int32_t slot) {
    const PathStates& p = state_->paths;
    const auto i = static_cast<size_t>(slot);
    const PathRequest& request = requests_[p.request[i]];
    PathSample& sample = sample_of(slot);
    const Medium& medium = c_.media[0];
    const dvec3 at = medium.to_world(dvec3(p.ox[i], p.oy[i], p.oz[i]));
    sample.flash = record_first_scatter(c_, c_.media, medium, request.ray.o, at, request.ray.d, dvec3(p.tr[i]),
                                        medium.albedo(at), sample);
  }

  /// Light scattered once is direct (docs/methods.md, Direct and indirect light).
  void deposit(size_t i, const vec3& L) {
    PathStates& p = state_->paths;
    const bool direct = is_direct(p.events[i]);
    (direct ? p.direct_r : p.indirect_r)[i] += L.x;
    (direct ? p.direct_g : p.indirect_g)[i] += L.y;
    (direct ? p.direct_b : p.indirect_b)[i] += L.z;
  }

  /// Adds the light samples, dimmed by the transmittance of their shadow rays.
  void add_light() {
    PathStates& p = state_->paths;
    for (size_t k = 0; k < state_->shadows.count; ++k) {
      const auto i = static_cast<size_t>(state_->shadows.slot[k]);
      deposit(i, vec3(p.cr[i], p.cg[i], p.cb[i]) * p.transmittance[i]);
    }
  }

  void finish(int32_t slot) {
    const PathStates& p = state_->paths;
    const CameraRayLayers& camera = state_->camera;
    const auto i = static_cast<size_t>(slot);
    PathSample s;
    if (keeps_samples()) s = sample_of(slot);
    if (c_.plan.first_collision.forced || p.events[i] == 0)
      see_background(requests_[p.request[i]].ray, static_cast<double>(p.passed[i]), s);
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
  LaneScene scene_;
  HomogeneousShape box_;  // of the grid
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
