#include "render/transport/wavefront.h"

#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <tuple>
#include <vector>

#include "render/transport/camera_rays.h"
#include "render/transport/estimator.h"
#include "render/transport/flight_emission.h"
#include "render/transport/flights.h"
#include "render/transport/media_flights.h"
#include "render/transport/near_flights.h"
#include "render/transport/path_layers.h"
#include "render/transport/path_recorder.h"
#include "render/transport/scatter.h"
#include "render/transport/surface_events.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();
/// Paths in flight where there are meshes, whose scalar work reads more of each path's state: that of fewer stays in
/// the cache. In kernels alone more paths keep lanes busier.
constexpr size_t kPoolAtSurfaces = kPool / 4;

/// The memory of the paths in flight on one thread, kept from batch to batch.
struct Pool {
  PathStates paths{};
  SlotList fresh, active, hits, met, escapes, shadows, alive, of_medium;
  SlotList passed;                              // a light, and go on behind it
  SlotList emission_only;                       // camera rays that miss the grid, but not what emits
  std::array<const FiniteLight*, kPool> light;  // that a flight ends on, where Plan::one_grid
  std::vector<PathSample> samples;              // of the paths, where layers are recorded that PathStates has not
  CameraRays::Buffers camera_rays;
  std::unique_ptr<WorldPaths> world;                  // unless Plan::one_grid
  std::unique_ptr<FlightEmission::Buffers> emission;  // where something emits
};

Pool& pool_of_thread(const Plan& plan) {
  static thread_local Pool pool;
  if (plan.marched() || plan.first_event || plan.first_surface) pool.samples.resize(kPool);
  if (plan.emission && !pool.emission) pool.emission = std::make_unique<FlightEmission::Buffers>();
  if (!plan.one_grid && !pool.world) pool.world = std::make_unique<WorldPaths>();
  return pool;
}

/// The paths in flight on one thread, stage by stage.
class Wavefront {
 public:
  Wavefront(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
            PathCounters& counters)
      : c_(context),
        requests_(requests),
        sink_(sink),
        counters_(counters),
        pool_(pool_of_thread(context.plan)),
        p_(pool_.paths),
        w_(context.plan.one_grid ? nullptr : pool_.world.get()),
        camera_rays_(context, requests, pool_.paths, pool_.camera_rays, pool_.samples) {
    if (c_.plan.emission) emission_.emplace(c_, p_, w_, *pool_.emission);
    if (!w_) {
      grid_ = lane_scene(c_, 0, nullptr);
      const auto [lo, hi] = c_.media[0].support();
      box_ = {HomogeneousShape::Shape::kBox, lo, hi};
      return;
    }
    flights_.emplace(c_, p_, *w_, counters_.tracking);
    near_flights_.emplace(c_, p_, *w_, *flights_, counters_.tracking);
    if (c_.surfaces) surfaces_.emplace(c_, p_, *w_, pool_.samples, counters_);
    if (c_.plan.layers.records) recorder_.emplace(c_, p_, *w_);
  }

  void run() {
    pool_.active.count = 0;
    const size_t size = surfaces_ ? kPoolAtSurfaces : kPool;
    free_.resize(size);
    for (size_t i = 0; i < size; ++i) free_[i] = static_cast<int32_t>(size - 1 - i);
    counters_.tracking.stop = c_.stop;
    for (;;) {
      if (c_.stop != nullptr) c_.stop->check();
      for (SlotList* list :
           {&pool_.hits, &pool_.met, &pool_.escapes, &pool_.shadows, &pool_.alive, &pool_.passed, &pool_.emission_only})
        list->count = 0;
      start_paths();
      if (pool_.active.count + pool_.hits.count + pool_.emission_only.count == 0) break;
      w_ ? fly_in_world() : fly_in_grid();
      if (emission_ && !c_.plan.chromatic) emission_->add({&pool_.hits, &pool_.met, &pool_.escapes});
      for (size_t k = 0; k < pool_.escapes.count; ++k) escape(pool_.escapes.slot[k]);
      counters_.tracking.collisions += pool_.hits.count;
      if (c_.plan.first_event) record_first_events();
      w_ ? scatter_in_world() : scatter_in_grid();
      add_light();
      retire();
    }
  }

 private:
  bool keeps_samples() const { return c_.plan.marched() || c_.plan.first_event || c_.plan.first_surface; }

  // ---- camera rays

  /// Fills the free slots, and records what follows from the camera rays alone.
  void start_paths() {
    SlotList& fresh = pool_.fresh;
    while (!free_.empty() && next_ < requests_.size()) {
      fresh.count = 0;
      while (!free_.empty() && next_ < requests_.size()) w_ ? start_in_world(next_++) : start_in_grid(next_++);
      if (w_)
        camera_rays_.record_in_world(*flights_, *w_, fresh);
      else
        camera_rays_.record_in_grid(grid_, fresh);
      if (c_.plan.first_collision.forced) {
        fly_first();
        continue;
      }
      for (size_t k = 0; k < fresh.count; ++k) pool_.active.push(fresh.slot[k]);
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
    if (!meets && !(emission_ && emission_->may_meet(request.ray))) {
      pass_by(index);
      return;
    }
    const int32_t slot = take_slot(index);
    const auto i = static_cast<size_t>(slot);
    const dvec3 o = meets ? local.at(entry) : dvec3(0);
    p_.ox[i] = static_cast<float>(o.x);
    p_.oy[i] = static_cast<float>(o.y);
    p_.oz[i] = static_cast<float>(o.z);
    p_.lx[i] = static_cast<float>(local.d.x * grid_.unit);
    p_.ly[i] = static_cast<float>(local.d.y * grid_.unit);
    p_.lz[i] = static_cast<float>(local.d.z * grid_.unit);
    const double ahead = request.start.surface;
    camera_rays_.start(slot, ahead < exit ? static_cast<float>(std::max(ahead - entry, 0.0) / grid_.unit) : -1.0f);
    (meets ? pool_.fresh : pool_.emission_only).push(slot);
  }

  /// Starts a path in a free slot at the eye.
  void start_in_world(size_t index) {
    const PathRequest& request = requests_[index];
    ++counters_.paths;
    if (!surfaces_ && !flights_->met_by(request.ray, request.time) &&
        !(emission_ && emission_->may_meet(request.ray))) {
      pass_by(index);
      return;
    }
    const int32_t slot = take_slot(index);
    const auto i = static_cast<size_t>(slot);
    w_->ray[i] = request.ray;
    w_->time[i] = request.time;
    w_->past[i] = {};
    w_->surface[i] = vec3(0);
    w_->record[i] = request.record;
    p_.time[i] = static_cast<float>(request.time);
    flights_->place(i, request.time);
    camera_rays_.start(slot, 0);
    pool_.fresh.push(slot);
  }

  /// A path that meets nothing but the background.
  void pass_by(size_t index) {
    PathSample sample;
    see_background(requests_[index].ray, dvec3(1), sample, /*alone=*/true);
    deliver(index, sample, false);
  }

  /// A free slot, set up for a request but for its place.
  int32_t take_slot(size_t index) {
    const PathRequest& request = requests_[index];
    const int32_t slot = free_.back();
    free_.pop_back();
    const auto i = static_cast<size_t>(slot);
    p_.dx[i] = static_cast<float>(request.ray.d.x);
    p_.dy[i] = static_cast<float>(request.ray.d.y);
    p_.dz[i] = static_cast<float>(request.ray.d.z);
    p_.tr[i] = p_.tg[i] = p_.tb[i] = 1.0f;
    p_.direct_r[i] = p_.direct_g[i] = p_.direct_b[i] = p_.indirect_r[i] = p_.indirect_g[i] = p_.indirect_b[i] = 0.0f;
    p_.passed[i] = 1.0f;
    p_.events[i] = 0;
    p_.request[i] = static_cast<uint32_t>(index);
    PathGenerator(p_, i).seed(hash_combine(request.key.pixel_hash(), request.key.sample));
    if (keeps_samples()) pool_.samples[i] = {};
    if (emission_) emission_->start(slot);
    if (c_.plan.chromatic) {
      p_.qr[i] = p_.qg[i] = p_.qb[i] = 1.0f;
      p_.hero[i] = std::min(2, static_cast<int>(3 * PathGenerator(p_, i).uniform()));
    }
    return slot;
  }

  /// Forced first collisions of the camera rays: the transmitted share sees the background, the rest goes on as paths.
  void fly_first() {
    find_ends_in_grid(pool_.fresh);
    lanes_fly_first(grid_, p_, pool_.fresh, pool_.hits, pool_.escapes, counters_.tracking.lookups);
    for (size_t k = 0; k < pool_.escapes.count; ++k) escape(pool_.escapes.slot[k]);
    pool_.escapes.count = 0;
  }

  // ---- flights

  /// A path's current ray, in the world.
  Ray flight(size_t i) const {
    if (w_) return w_->ray[i];
    return {c_.media[0].to_world(dvec3(p_.ox[i], p_.oy[i], p_.oz[i])), direction(i)};
  }

  dvec3 direction(size_t i) const { return glm::normalize(dvec3(p_.dx[i], p_.dy[i], p_.dz[i])); }

  /// Finds the lights that flights end on, and keeps the flights themselves where emission is integrated along them. A
  /// light in front of the medium ends the camera ray where the medium begins.
  void find_ends_in_grid(const SlotList& rays) {
    if (!grid_.flights_end && !emission_) return;
    for (size_t k = 0; k < rays.count; ++k) {
      const auto i = static_cast<size_t>(rays.slot[k]);
      const Ray ray = flight(i);
      const bool camera = p_.events[i] == 0;
      const Ray& whole = camera ? requests_[p_.request[i]].ray : ray;
      double end = kFar;
      if (grid_.flights_end) {
        std::tie(pool_.light[i], end) = c_.lights->nearest(whole, end, camera);
        const double t_max = std::max(end - glm::dot(ray.o - whole.o, whole.d), 0.0);
        p_.t_max[i] = static_cast<float>(std::min(t_max / grid_.unit, 1e30));
      }
      if (emission_) emission_->set(i, whole, end);
    }
  }

  void fly_in_grid() {
    find_ends_in_grid(pool_.active);
    find_ends_in_grid(pool_.emission_only);
    lanes_fly(grid_, p_, pool_.active, pool_.hits, pool_.escapes, counters_.tracking.lookups);
    for (size_t k = 0; k < pool_.emission_only.count; ++k) pool_.escapes.push(pool_.emission_only.slot[k]);
    if (!emission_) return;
    for (size_t k = 0; k < pool_.hits.count; ++k) {
      const auto i = static_cast<size_t>(pool_.hits.slot[k]);
      const Ray& whole = emission_->ray(i);
      emission_->set(i, whole, glm::dot(flight(i).o - whole.o, whole.d));
    }
  }

  /// Free flights through all media, up to the nearest light or surface, and what they come to.
  void fly_in_world() {
    const SlotList& active = pool_.active;
    for (size_t k = 0; k < active.count; ++k) find_end_in_world(static_cast<size_t>(active.slot[k]));
    near_flights_->add(active);
    flights_->fly(active);
    if (c_.plan.chromatic) {
      if (emission_) emission_->add_by_channel(active, *flights_);
      flights_->weigh_channels(active);
    }
    for (size_t k = 0; k < active.count; ++k) {
      const int32_t slot = active.slot[k];
      const auto i = static_cast<size_t>(slot);
      SlotList& list = w_->medium[i] != WorldPaths::kNoMedium ? pool_.hits
                       : w_->on_surface[i]                    ? pool_.met
                                                              : pool_.escapes;
      list.push(slot);
    }
  }

  /// The light or surface that a flight ends on at last.
  void find_end_in_world(size_t i) {
    Ray& ray = w_->ray[i];
    if (p_.events[i] > 0) ray.d = direction(i);
    w_->end[i] = kFar;
    w_->light[i] = nullptr;
    w_->medium[i] = WorldPaths::kNoMedium;
    w_->on_surface[i] = false;
    if (c_.plan.finite_lights) {
      const double passed = w_->past[i].passed;
      std::tie(w_->light[i], w_->end[i]) = c_.lights->nearest(w_->from_vertex(i), kFar, p_.events[i] == 0, passed);
      w_->end[i] -= passed;
    }
    if (!surfaces_) return;
    if (const auto hit = c_.surfaces->intersect(ray, w_->end[i], w_->time[i], p_.events[i] == 0)) {
      w_->hit[i] = *hit;
      w_->end[i] = hit->t;
      w_->on_surface[i] = true;
    }
  }

  // ---- events

  void record_first_events() {
    for (size_t k = 0; k < pool_.hits.count; ++k) {
      const auto i = static_cast<size_t>(pool_.hits.slot[k]);
      if (p_.events[i] > 0) continue;
      const PathRequest& request = requests_[p_.request[i]];
      const std::span<const Medium> media = media_at(c_, request.time);
      const Medium& medium = media[w_ ? static_cast<size_t>(w_->medium[i]) : 0];
      const dvec3 at = w_ ? w_->ray[i].at(w_->end[i]) : flight(i).o;
      PathSample& sample = pool_.samples[i];
      sample.flash = record_first_scatter(c_, media, medium, request.ray.o, at, request.ray.d,
                                          dvec3(p_.tr[i], p_.tg[i], p_.tb[i]), medium.albedo(at), sample);
    }
  }

  void scatter_in_grid() {
    lanes_scatter(grid_, p_, pool_.hits, pool_.shadows, pool_.alive, counters_.capped_paths,
                  counters_.capped_throughput);
    lanes_shadow(grid_, p_, pool_.shadows, counters_.tracking.lookups);
  }

  /// The events at the ends of the flights, and the shadow rays of their light samples.
  void scatter_in_world() {
    if (recorder_) recorder_->collide(pool_.hits);
    for (size_t m = 0; m < flights_->count(); ++m) scatter_in(m);
    if (recorder_) recorder_->turn(pool_.alive);
    for (size_t k = 0; k < pool_.met.count; ++k) {
      const int32_t slot = pool_.met.slot[k];
      const PathRequest& request = requests_[p_.request[static_cast<size_t>(slot)]];
      if (surfaces_->meet(slot, request.ray.o, pool_.shadows)) pool_.alive.push(slot);
    }
    if (recorder_) recorder_->sample_lights(pool_.shadows);
    if (surfaces_) surfaces_->shadow(pool_.shadows);
    flights_->shadow(pool_.shadows);
    if (recorder_) recorder_->receive(pool_.shadows);
  }

  /// The collisions with one medium: each has its phase function.
  void scatter_in(size_t medium) {
    SlotList& mine = pool_.of_medium;
    mine.count = 0;
    for (size_t k = 0; k < pool_.hits.count; ++k) {
      const auto i = static_cast<size_t>(pool_.hits.slot[k]);
      if (w_->medium[i] != static_cast<int32_t>(medium)) continue;
      w_->ray[i].o = w_->ray[i].at(w_->end[i]);
      w_->past[i] = {.sampled_light = true, .first_on_surface = w_->past[i].first_on_surface, .in_medium = true};
      w_->shadow_end[i] = kFar;
      mine.push(pool_.hits.slot[k]);
    }
    const size_t first = pool_.shadows.count;
    lanes_scatter(flights_->scene(medium), p_, mine, pool_.shadows, pool_.alive, counters_.capped_paths,
                  counters_.capped_throughput);
    for (size_t k = first; k < pool_.shadows.count; ++k) {
      const auto i = static_cast<size_t>(pool_.shadows.slot[k]);
      w_->shadow[i] = {w_->ray[i].o, glm::normalize(dvec3(p_.sx[i], p_.sy[i], p_.sz[i]))};
    }
  }

  /// Adds the light samples, dimmed by the transmittance of their shadow rays.
  void add_light() {
    for (size_t k = 0; k < pool_.shadows.count; ++k) {
      const auto i = static_cast<size_t>(pool_.shadows.slot[k]);
      vec3 L = vec3(p_.cr[i], p_.cg[i], p_.cb[i]) * p_.transmittance[i];
      if (c_.plan.chromatic) L *= vec3(p_.shadow_r[i], p_.shadow_g[i], p_.shadow_b[i]);
      if (w_ && w_->past[i].to_catcher)
        pool_.samples[i].catcher += dvec3(L);
      else
        deposit(p_, w_, i, L, p_.events[i]);
    }
  }

  // ---- ends

  /// Goes on with the paths that are alive, and finishes the others.
  void retire() {
    for (size_t k = 0; k < pool_.alive.count; ++k) alive_[static_cast<size_t>(pool_.alive.slot[k])] = true;
    for (const SlotList* ended : {&pool_.hits, &pool_.met})
      for (size_t k = 0; k < ended->count; ++k) {
        const auto i = static_cast<size_t>(ended->slot[k]);
        if (!alive_[i]) finish(ended->slot[k]);
        alive_[i] = false;
      }
    pool_.active = pool_.alive;
    for (size_t k = 0; k < pool_.passed.count; ++k) pool_.active.push(pool_.passed.slot[k]);
  }

  /// Adds the light found by a path that has left the medium, or has hit a light.
  void escape(int32_t slot) {
    const auto i = static_cast<size_t>(slot);
    const uint32_t events = p_.events[i];
    const vec3 throughput(p_.tr[i], p_.tg[i], p_.tb[i]);
    const bool passes = w_ && w_->light[i] && !w_->light[i]->solid();
    if (events > 0)
      deposit(p_, w_, i, throughput * vec3(light_ahead(i)), events);
    else if (passes)
      w_->surface[i] += throughput * vec3(w_->light[i]->radiance(w_->from_vertex(i), w_->past[i].passed + w_->end[i]));
    if (!passes) {
      finish(slot);
      return;
    }
    w_->ray[i].o = w_->ray[i].at(w_->end[i]);
    w_->past[i].passed += w_->end[i];
    pool_.passed.push(slot);
  }

  /// What a scattered path finds by its direction, weighted against light sampling.
  dvec3 light_ahead(size_t i) const {
    const Ray ray = w_ ? w_->from_vertex(i) : flight(i);
    const WorldPaths::Past past = w_ ? w_->past[i] : WorldPaths::Past{.in_medium = true};
    const auto share = [&](const Light& light) {
      return c_.plan.light_sampling ? c_.lights->choice_probability(light, ray.o) : 0.0;
    };
    // Straight through glass, light sampling has found it.
    const auto weight = [&](double pdf_light) {
      if (past.straight && pdf_light > 0) return 0.0;
      return past.specular ? 1.0 : balance(static_cast<double>(p_.pdf[i]), pdf_light);
    };
    const FiniteLight* light = w_ ? w_->light[i] : grid_.flights_end ? pool_.light[i] : nullptr;
    if (light) {
      const double t = w_ ? past.passed + w_->end[i] : p_.t_max[i] * grid_.unit;
      const dvec3 L = light->radiance(ray, t) * weight(share(*light) * light->pdf(ray, t));
      return past.in_medium ? L * far_share(c_.plan.near_lights, light, ray.o) : L;
    }
    dvec3 L(0);
    for (const InfiniteLight* infinite : c_.lights->infinite()) {
      const dvec3 radiance = infinite->radiance(ray.d);
      if (radiance == dvec3(0)) continue;
      const double probability = share(*infinite);
      L += radiance * weight(probability > 0 ? probability * infinite->pdf(ray.d) : 0.0);
    }
    return L;
  }

  /// What a camera ray sees behind the medium, in full precision.
  void see_background(const Ray& ray, const dvec3& transmittance, PathSample& sample, bool alone) const {
    sample.transmittance = transmittance;
    auto [light, t] = c_.lights->nearest(ray, kFar, true);
    while (light && !light->solid()) {
      // A path has added it where it passed; a ray that meets nothing has no path.
      if (alone) sample.background += transmittance * light->radiance(ray, t);
      std::tie(light, t) = c_.lights->nearest(ray, kFar, true, t);
    }
    if (light) {
      sample.background += transmittance * light->radiance(ray, t);
      return;
    }
    for (const InfiniteLight* infinite : c_.lights->infinite())
      if (infinite->visible()) sample.background += transmittance * infinite->radiance(ray.d);
  }

  void finish(int32_t slot) {
    const auto i = static_cast<size_t>(slot);
    const dvec3 throughput(p_.tr[i], p_.tg[i], p_.tb[i]);
    PathSample s;
    if (keeps_samples()) s = pool_.samples[i];
    if (w_) s.surface = dvec3(w_->surface[i]);
    if (w_ && w_->past[i].in_hole)
      s.transmittance = throughput;  // nothing is there, and alpha says so
    else if (c_.plan.first_collision.forced || p_.events[i] == 0)
      see_background(requests_[p_.request[i]].ray, c_.plan.chromatic ? throughput : dvec3(p_.passed[i]), s,
                     /*alone=*/false);
    camera_rays_.write(i, s);
    if (emission_) s.emission = dvec3(emission_->seen(i));
    s.single = {p_.direct_r[i], p_.direct_g[i], p_.direct_b[i]};
    s.indirect = {p_.indirect_r[i], p_.indirect_g[i], p_.indirect_b[i]};
    deliver(p_.request[i], s, w_ && w_->past[i].first_on_surface);
    counters_.longest = std::max<uint64_t>(counters_.longest, p_.events[i]);
    free_.push_back(slot);
  }

  void deliver(size_t request, PathSample& s, bool surface_first) const {
    s.direct = s.background + s.emission + s.single + s.surface;
    limit_indirect(c_.indirect_limit, s.indirect, counters_.limited);
    (surface_first ? s.surface_indirect : s.volume_indirect) = s.indirect;
    s.beauty = s.direct + s.indirect;
    if (c_.plan.flash) s.flash = flash_image(s.direct, c_.flash.intensity, s.flash);
    if (requests_[request].record) finish_record(*requests_[request].record, s, surface_first);
    sink_(request, s);
  }

  const PathContext& c_;
  std::span<const PathRequest> requests_;
  const SampleSink& sink_;
  PathCounters& counters_;
  Pool& pool_;
  PathStates& p_;
  WorldPaths* w_;         // null where Plan::one_grid
  LaneScene grid_{};      // the one grid, where Plan::one_grid
  HomogeneousShape box_;  // around it
  CameraRays camera_rays_;
  std::optional<FlightEmission> emission_;
  std::optional<MediaFlights> flights_;  // this and the rest unless Plan::one_grid
  std::optional<NearFlights> near_flights_;
  std::optional<SurfaceEvents> surfaces_;
  std::optional<PathRecorder> recorder_;
  size_t next_ = 0;
  std::vector<int32_t> free_;
  std::array<bool, kPool> alive_{};
};

}  // namespace

void trace_paths(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
                 PathCounters& counters) {
  Wavefront(context, requests, sink, counters).run();
}

}  // namespace brume
