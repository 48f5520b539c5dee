#include "render/transport/wavefront.h"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "render/transport/camera_rays.h"
#include "render/transport/camera_splits.h"
#include "render/transport/estimator.h"
#include "render/transport/flight_emission.h"
#include "render/transport/group_lights.h"
#include "render/transport/lit_balls.h"
#include "render/transport/media_flights.h"
#include "render/transport/near_flights.h"
#include "render/transport/path_layers.h"
#include "render/transport/path_recorder.h"
#include "render/transport/scatter.h"
#include "render/transport/surface_events.h"

namespace brume {
namespace {

/// Paths in flight where there are meshes, whose scalar work reads more of each path's state: that of fewer stays in
/// the cache. In kernels alone more paths keep lanes busier.
constexpr size_t kPoolAtSurfaces = kPool / 4;

/// The memory of the paths in flight on one thread, kept from batch to batch.
struct Pool {
  PathStates paths{};
  WorldPaths world;
  SlotList fresh, active, hits, met, escapes, shadows, alive, of_medium;
  SlotList passed;                  // a light, and go on behind it
  SlotList held;                    // out: camera rays that a holdout volume ends
  SlotList emission_only;           // camera rays that miss the one grid, but not what emits
  SlotList again, resumed;          // camera rays from which another path has to go on; those of the round before
  std::vector<PathSample> samples;  // of the paths, where layers are recorded that PathStates has not
  CameraRays::Buffers camera_rays;
  std::unique_ptr<FlightEmission::Buffers> emission;  // where something emits
};

Pool& pool_of_thread(const Plan& plan) {
  static thread_local Pool pool;
  if (plan.marched() || plan.first_event || plan.first_surface) pool.samples.resize(kPool);
  if (plan.emission && !pool.emission) pool.emission = std::make_unique<FlightEmission::Buffers>();
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
        w_(pool_.world),
        flights_(c_, p_, w_, counters_.tracking),
        camera_rays_(context, requests, p_, w_, flights_, pool_.camera_rays, pool_.samples) {
    w_.any_surface = c_.surfaces != nullptr;
    w_.groups = c_.lights->groups().size();
    w_.group_light.resize(kPool * w_.groups);
    found_.resize(w_.groups);
    aimed_.resize(w_.groups);
    group_values_.resize(4 * w_.groups);
    if (c_.plan.emission) emission_.emplace(c_, p_, w_, *pool_.emission);
    if (!c_.plan.near_lights.empty()) near_flights_.emplace(c_, p_, w_, flights_, counters_.tracking);
    if (!c_.plan.lit_balls.empty()) balls_ = std::make_unique<BallSamples>(c_, p_, w_, flights_);
    if (c_.surfaces) surfaces_.emplace(c_, p_, w_, pool_.samples, counters_);
    if (GroupLights::wanted(c_))
      group_lights_.emplace(c_, p_, w_, flights_, surfaces_ ? &*surfaces_ : nullptr, balls_.get());
    if (c_.plan.first_collision.paths.most() > 1) splits_ = std::make_unique<CameraSplits>(keeps_samples());
    if (c_.plan.layers.records) recorder_.emplace(c_, p_, w_);
  }

  void run() {
    pool_.active.clear();
    pool_.again.clear();
    const size_t size = surfaces_ ? kPoolAtSurfaces : kPool;
    free_.resize(size);
    for (size_t i = 0; i < size; ++i) free_[i] = size - 1 - i;
    counters_.tracking.stop = c_.stop;
    for (;;) {
      if (c_.stop != nullptr) c_.stop->check();
      for (SlotList* list : {&pool_.hits, &pool_.met, &pool_.escapes, &pool_.shadows, &pool_.alive, &pool_.passed,
                             &pool_.held, &pool_.emission_only})
        list->clear();
      start_paths();
      if (pool_.active.count + pool_.hits.count + pool_.emission_only.count + pool_.again.count == 0) break;
      fly();
      if (emission_ && !c_.plan.chromatic) emission_->add({&pool_.hits, &pool_.met, &pool_.escapes, &pool_.held});
      for (const size_t i : pool_.held) finish(i);
      for (const size_t i : pool_.escapes) escape(i);
      counters_.tracking.collisions += pool_.hits.count + pool_.held.count;
      if (c_.plan.first_event) record_first_events();
      scatter();
      add_light();
      retire();
    }
  }

 private:
  bool keeps_samples() const { return c_.plan.marched() || c_.plan.first_event || c_.plan.first_surface; }

  // ---- camera rays

  /// Fills the free slots, and records what follows from the camera rays alone.
  void start_paths() {
    if (pool_.again.count > 0) {
      pool_.resumed = pool_.again;
      pool_.again.clear();
      send(pool_.resumed);
    }
    SlotList& fresh = pool_.fresh;
    while (!free_.empty() && next_ < requests_.size()) {
      fresh.clear();
      while (!free_.empty() && next_ < requests_.size()) start(next_++);
      camera_rays_.record(fresh);
      send(fresh);
    }
  }

  /// Lets paths begin to fly along their camera rays.
  void send(const SlotList& rays) {
    if (c_.plan.first_collision.forced) return fly_first(rays);
    for (const size_t i : rays) pool_.active.push(i);
  }

  /// Starts a path in a free slot at the eye.
  void start(size_t index) {
    const PathRequest& request = requests_[index];
    ++counters_.paths;
    const size_t i = free_.back();
    const MediaFlights::Start begin = flights_.start(i, request);
    if (!begin.meets && !(emission_ && emission_->may_meet(request.ray))) {
      pass_by(index);
      return;
    }
    free_.pop_back();
    if (!c_.plan.one_grid) {
      w_.surface[i] = vec3(0);
      w_.record[i] = request.record;
    }
    p_.direct.set(i, vec3(0));
    p_.indirect.set(i, vec3(0));
    w_.clear_groups(i);
    if (group_lights_) group_lights_->start(i);
    p_.request[i] = static_cast<uint32_t>(index);
    PathGenerator(p_, i).seed(hash_combine(request.key.pixel_hash(), request.key.sample));
    if (keeps_samples()) pool_.samples[i] = {};
    const int splits = begin.meets ? c_.plan.first_collision.paths.of_pixel(request.key.pixel) : 1;
    if (splits_) splits_->start(i, splits);
    if (emission_) emission_->start(i, splits);
    begin_path(i, request);
    camera_rays_.start(i, begin.surface);
    (begin.meets || !c_.plan.one_grid ? pool_.fresh : pool_.emission_only).push(i);
  }

  /// Puts a path at the eye into a slot.
  void begin_path(size_t i, const PathRequest& request) {
    if (!c_.plan.one_grid) w_.past[i] = {};
    p_.d.set(i, vec3(request.ray.d));
    p_.throughput.set(i, vec3(1));
    p_.camera_transmittance[i] = 1.0f;
    p_.events[i] = 0;
    if (!c_.plan.chromatic) return;
    p_.channel_density.set(i, vec3(1));
    p_.hero[i] = std::min(2, static_cast<int>(3 * PathGenerator(p_, i).uniform()));
  }

  /// Lets another path go on from the camera ray of a slot.
  void begin_again(size_t i) {
    const PathRequest& request = requests_[p_.request[i]];
    flights_.start(i, request);
    begin_path(i, request);
    emission_->start_again(i);
    pool_.again.push(i);
  }

  /// A path that meets nothing but the background.
  void pass_by(size_t index) {
    PathSample sample;
    std::fill(found_.begin(), found_.end(), FoundLight{});
    std::fill(aimed_.begin(), aimed_.end(), FoundLight{});
    see_background(requests_[index].ray, dvec3(1), sample, /*alone=*/true);
    deliver(index, sample, false);
  }

  /// Forced first collisions of the camera rays: the transmitted share sees the background, the rest goes on as paths.
  void fly_first(const SlotList& rays) {
    find_ends(rays);
    see_emission(rays);
    flights_.fly_first_in_grid(rays, pool_.hits, pool_.escapes);
    for (const size_t i : pool_.escapes) escape(i);
    pool_.escapes.clear();
  }

  /// What camera rays see of what media emit, where that needs no flight.
  void see_emission(const SlotList& rays) {
    if (c_.plan.seen_emission) emission_->see(rays, flights_);
  }

  // ---- flights

  /// Free flights through all media, up to the nearest light or surface, and what they come to.
  void fly() {
    const SlotList& active = pool_.active;
    find_ends(active);
    see_emission(active);
    if (c_.plan.one_grid) {
      find_ends(pool_.emission_only);
      see_emission(pool_.emission_only);
      flights_.fly_in_grid(active, pool_.hits, pool_.escapes);
      for (const size_t i : pool_.emission_only) pool_.escapes.push(i);
      if (!emission_) return;
      for (const size_t i : pool_.hits) w_.end[i] = glm::dot(position(i) - w_.ray[i].o, w_.ray[i].d);
      return;
    }
    if (near_flights_) near_flights_->add(active);
    MediaFlights::Flown flown = flights_.fly(active);
    if (c_.plan.chromatic) {
      if (emission_) emission_->add_by_channel(active, flown);
      std::move(flown).weigh_channels();
    }
    for (const size_t i : active) {
      w_.past[i].in_hole = is_held(i);
      SlotList& list = w_.past[i].in_hole                      ? pool_.held
                       : w_.medium[i] != WorldPaths::kNoMedium ? pool_.hits
                       : w_.on_surface[i]                      ? pool_.met
                                                               : pool_.escapes;
      list.push(i);
    }
  }

  /// Whether a flight from the eye ends in a holdout.
  bool is_held(size_t i) const {
    return c_.plan.holdouts && p_.events[i] == 0 && w_.medium[i] != WorldPaths::kNoMedium &&
           c_.media[static_cast<size_t>(w_.medium[i])].holdout();
  }

  /// The lights and surfaces that flights end on at last. In the one grid they are looked for only where flights can
  /// end before it does, or something is integrated up to there.
  void find_ends(const SlotList& rays) {
    if (c_.plan.one_grid && !c_.plan.finite_lights && !emission_) return;
    for (const size_t i : rays) find_end(i);
  }

  void find_end(size_t i) {
    const bool camera = p_.events[i] == 0;
    if (!camera) w_.ray[i] = from_event(i);
    w_.end[i] = kUnbounded;
    w_.light[i] = nullptr;
    if (c_.plan.finite_lights) {
      const double passed = w_.past_of(i, c_.plan).passed;
      std::tie(w_.light[i], w_.end[i]) =
          c_.lights->nearest({w_.ray[i].o - passed * w_.ray[i].d, w_.ray[i].d}, kUnbounded, camera, passed);
      w_.end[i] -= passed;
    }
    if (c_.plan.one_grid) {
      // A light in front of the grid ends the camera ray where the grid begins.
      const double t_max = std::max(w_.end[i] - (camera ? w_.begin[i] : 0.0), 0.0);
      p_.flight.end[i] = static_cast<float>(std::min(t_max / flights_.scene(0).unit, 1e30));
      return;
    }
    w_.medium[i] = WorldPaths::kNoMedium;
    w_.on_surface[i] = false;
    if (!surfaces_) return;
    if (const auto hit = c_.surfaces->intersect(w_.ray[i], w_.end[i], w_.time[i], camera)) {
      w_.hit[i] = *hit;
      w_.end[i] = hit->t;
      w_.on_surface[i] = true;
    }
  }

  /// A path's ray after its last event. Media leave the direction in single precision.
  Ray from_event(size_t i) const {
    return {c_.plan.one_grid ? position(i) : w_.ray[i].o, glm::normalize(dvec3(p_.d[i]))};
  }

  /// Where a flight has ended in a medium; in the one grid until the next one ends.
  dvec3 position(size_t i) const {
    return c_.plan.one_grid ? c_.media[0].to_world(dvec3(p_.flight.o[i])) : w_.ray[i].at(w_.end[i]);
  }

  // ---- events

  void record_first_events() {
    for (const size_t i : pool_.hits) {
      if (p_.events[i] > 0) continue;
      const PathRequest& request = requests_[p_.request[i]];
      const std::span<const Medium> media = media_at(c_, request.time);
      const Medium& medium = media[c_.plan.one_grid ? 0 : static_cast<size_t>(w_.medium[i])];
      const dvec3 at = position(i);
      const auto record = [&](const Medium& own) {
        PathSample& sample = pool_.samples[i];
        sample.flash = record_first_scatter(c_, media, own, request.ray.o, at, request.ray.d, dvec3(p_.throughput[i]),
                                            own.albedo(at), sample);
      };
      medium.instances() ? record(medium.instance(static_cast<size_t>(w_.instance[i]))) : record(medium);
    }
  }

  /// The events at the ends of the flights, and the shadow rays of their light samples.
  void scatter() {
    if (balls_)
      for (const size_t i : pool_.hits) balls_->leave(i);
    if (group_lights_) group_lights_->begin_vertices(requests_, pool_.hits, pool_.met);
    if (recorder_) recorder_->collide(pool_.hits);
    for (size_t m = 0; m < flights_.count(); ++m) scatter_in(m);
    if (balls_) balls_->weigh(pool_.shadows);
    if (recorder_) recorder_->turn(pool_.alive);
    for (const size_t i : pool_.met)
      if (surfaces_->meet(i, requests_[p_.request[i]].ray.o, pool_.shadows, balls_.get(),
                          group_lights_ ? &*group_lights_ : nullptr))
        pool_.alive.push(i);
    if (recorder_) recorder_->sample_lights(pool_.shadows);
    if (surfaces_) surfaces_->shadow(pool_.shadows);
    flights_.shadow(pool_.shadows);
    if (recorder_) recorder_->receive(pool_.shadows);
  }

  /// The collisions with one medium: each has its phase function.
  void scatter_in(size_t medium) {
    const auto scatter = [&](SlotList& hits) {
      lanes_scatter(flights_.scene(medium), p_, hits, pool_.shadows, pool_.alive, counters_.capped_paths,
                    counters_.capped_throughput);
    };
    if (c_.plan.one_grid) return scatter(pool_.hits);
    SlotList& mine = pool_.of_medium;
    mine.clear();
    for (const size_t i : pool_.hits) {
      if (w_.medium[i] != static_cast<int32_t>(medium)) continue;
      if (balls_) draw_ball_point(i, medium);
      w_.ray[i].o = position(i);
      w_.last_collision[i] = {w_.medium[i], w_.instance[i]};
      w_.past[i] = {.sampled_light = true,
                    .samples_fields = c_.plan.samples_fields(medium),
                    .first_on_surface = w_.past[i].first_on_surface};
      w_.shadow_end[i] = kUnbounded;
      mine.push(i);
    }
    const size_t first = pool_.shadows.count;
    scatter(mine);
    for (size_t k = first; k < pool_.shadows.count; ++k) {
      const size_t i = pool_.shadows[k];
      w_.shadow[i] = {w_.ray[i].o, glm::normalize(dvec3(p_.wi[i]))};
    }
  }

  /// Aims at the smoke around a lamp from a collision.
  void draw_ball_point(size_t i, size_t medium) {
    const dvec3 p = position(i);
    const Medium& any = c_.media[medium];
    const dvec3 albedo = any.instances() ? any.albedo(static_cast<size_t>(w_.instance[i]), p) : any.albedo(p);
    balls_->draw(i, p, p_.events[i] + 1, [&](const dvec3& wi) {
      const double phase = any.phase().value(glm::dot(w_.ray[i].d, wi));
      return BallSamples::Scattering{dvec3(p_.throughput[i]) * albedo * phase, phase, p};
    });
  }

  /// Adds the light samples, dimmed by the transmittance of their shadow rays.
  void add_light() {
    for (const size_t i : pool_.shadows) {
      vec3 L = p_.contribution[i] * p_.transmittance[i];
      if (c_.plan.chromatic) L *= p_.shadow_colour[i];
      if (w_.past_of(i, c_.plan).to_catcher) {
        pool_.samples[i].catcher += dvec3(L);
        continue;
      }
      deposit(p_, w_, i, L, p_.events[i], w_.sampled_group[i]);
      if (group_lights_) group_lights_->take_from_picture(i, L);
    }
    if (balls_) balls_->trace();
    if (group_lights_) group_lights_->trace();
  }

  // ---- ends

  /// Roulette of paths that share a camera ray with others: CameraSplits::survival.
  bool survives_sharing(size_t i) {
    if (splits_->count(i) == 1 || (!c_.plan.one_grid && w_.medium[i] == WorldPaths::kNoMedium)) return true;
    const Medium& medium = c_.media[c_.plan.one_grid ? 0 : static_cast<size_t>(w_.medium[i])];
    const double chance = CameraSplits::survival(p_.events[i], max_component(medium.albedo()));
    if (chance == 1) return true;
    if (PathGenerator(p_, i).uniform() >= chance) return false;
    p_.throughput.set(i, p_.throughput[i] * static_cast<float>(1 / chance));
    return true;
  }

  /// Goes on with the paths that are alive, and finishes the others.
  void retire() {
    if (splits_) pool_.alive.keep_if([&](size_t i) { return survives_sharing(i); });
    for (const size_t i : pool_.alive) alive_[i] = true;
    for (const SlotList* ended : {&pool_.hits, &pool_.met})
      for (const size_t i : *ended) {
        if (!alive_[i]) finish(i);
        alive_[i] = false;
      }
    pool_.active = pool_.alive;
    for (const size_t i : pool_.passed) pool_.active.push(i);
  }

  /// Adds the light found by a path that has left the medium, or has hit a light.
  void escape(size_t i) {
    const uint32_t events = p_.events[i];
    const FiniteLight* const light = c_.plan.finite_lights ? w_.light[i] : nullptr;
    const FiniteLight* const passes = light && !light->solid() ? light : nullptr;
    if (events > 0)
      deposit(p_, w_, i, p_.throughput[i] * vec3(light_ahead(i, light)), events);
    else if (passes) {
      const vec3 L = p_.throughput[i] * vec3(passes->radiance(w_.from_vertex(i), w_.past[i].passed + w_.end[i]));
      w_.surface[i] += L;
      w_.add_to_group(i, passes->group, L, /*direct=*/true);
    }
    if (!passes) {
      finish(i);
      return;
    }
    w_.ray[i].o = w_.ray[i].at(w_.end[i]);
    w_.past[i].passed += w_.end[i];
    pool_.passed.push(i);
  }

  /// What a scattered path finds by its direction, weighted against light sampling. Groups get theirs.
  dvec3 light_ahead(size_t i, const FiniteLight* light) {
    const auto of_group = [&](const Light& of, const dvec3& L) {
      w_.add_to_group(i, of.group, p_.throughput[i] * vec3(L), is_direct(p_.events[i]));
      return L;
    };
    const WorldPaths::Past& past = w_.past_of(i, c_.plan);
    const Ray ray = c_.plan.one_grid ? from_event(i) : w_.from_vertex(i);
    const auto share = [&](const Light& of) {
      return c_.plan.light_sampling ? c_.lights->choice(past.samples_fields).probability(of, ray.o) : 0.0;
    };
    // Light seen straight through glass was sampled at the vertex before, so it is not counted again.
    const auto weight = [&](double pdf_light) {
      if (past.straight && pdf_light > 0) return 0.0;
      return past.specular ? 1.0 : balance(static_cast<double>(p_.pdf[i]), pdf_light);
    };
    const auto find = [&](const Light& of, const auto& weighted) {
      if (group_lights_) group_lights_->found(i, of, ray.o, past.samples_fields, weighted);
      return of_group(of, weighted(share(of)));
    };
    if (light) {
      const double t = past.passed + w_.end[i];
      return find(*light, [&](double probability) {
        const dvec3 L = light->radiance(ray, t) * weight(probability * light->pdf(ray, t));
        return past.on_surface ? L : L * far_share(c_.plan.near_lights, light, ray.o);
      });
    }
    dvec3 L(0);
    for (const InfiniteLight* infinite : c_.lights->infinite()) {
      const dvec3 radiance = infinite->radiance(ray.d);
      if (radiance == dvec3(0)) continue;
      L += find(*infinite, [&](double probability) {
        return radiance * weight(probability > 0 ? probability * infinite->pdf(ray.d) : 0.0);
      });
    }
    return L;
  }

  /// What a camera ray sees behind the medium, in full precision.
  void see_background(const Ray& ray, const dvec3& transmittance, PathSample& sample, bool alone) {
    sample.transmittance = transmittance;
    const auto see = [&](const Light& light, const dvec3& radiance) {
      sample.background += transmittance * radiance;
      if (!found_.empty()) found_[light.group].direct += transmittance * radiance;
    };
    auto [light, t] = c_.lights->nearest(ray, kUnbounded, true);
    while (light && !light->solid()) {
      // A path has added it where it passed; a ray that meets nothing has no path.
      if (alone) see(*light, light->radiance(ray, t));
      std::tie(light, t) = c_.lights->nearest(ray, kUnbounded, true, t);
    }
    if (light) {
      see(*light, light->radiance(ray, t));
      return;
    }
    for (const InfiniteLight* infinite : c_.lights->infinite())
      if (infinite->visible()) see(*infinite, infinite->radiance(ray.d));
  }

  void finish(size_t i) {
    counters_.longest = std::max<uint64_t>(counters_.longest, p_.events[i]);
    if (uint32_t* const events = requests_[p_.request[i]].events) *events += p_.events[i];
    CameraSplits::End end{.first_on_surface = w_.past_of(i, c_.plan).first_on_surface};
    if (w_.past_of(i, c_.plan).in_hole)
      end.hole = dvec3(p_.throughput[i]);
    else if (c_.plan.first_collision.forced || p_.events[i] == 0)
      end.background = c_.plan.chromatic ? dvec3(p_.throughput[i]) : dvec3(p_.camera_transmittance[i]);
    if (splits_ && splits_->end(i, end, p_.indirect[i], keeps_samples() ? &pool_.samples[i] : nullptr)) {
      begin_again(i);
      return;
    }
    deliver_path(i, end);
    free_.push_back(i);
  }

  /// The sample of a camera ray whose paths have all ended. @param end  of the last one
  void deliver_path(size_t i, const CameraSplits::End& end) {
    PathSample s;
    dvec3 background = end.background, hole = end.hole;
    double share = 1;
    const bool first_on_surface = w_.past_of(i, c_.plan).first_on_surface;
    if (splits_) {
      s = splits_->sample(i);
      background = splits_->background(i);
      hole = splits_->hole(i);
      share = splits_->share(i);
    } else if (keeps_samples()) {
      s = pool_.samples[i];
    }
    for (size_t g = 0; g < found_.size(); ++g) {
      const WorldPaths::GroupLight& light = w_.group_light[i * w_.groups + g];
      found_[g] = {share * dvec3(light.direct), share * dvec3(light.indirect)};
      if (!group_lights_) continue;
      const WorldPaths::GroupLight& more = group_lights_->apart(i, g);
      aimed_[g] = {share * dvec3(more.direct), share * dvec3(more.indirect)};
    }
    if (!c_.plan.one_grid) s.surface = share * dvec3(w_.surface[i]);
    if (background != dvec3(0)) see_background(requests_[p_.request[i]].ray, background, s, /*alone=*/false);
    s.transmittance += hole;  // nothing is there, and alpha says so
    camera_rays_.write(i, s);
    if (emission_) s.emission = dvec3(emission_->seen(i));
    s.single = share * dvec3(p_.direct[i]);
    s.indirect = share * dvec3(p_.indirect[i]);
    s.surface_indirect = splits_ ? splits_->surface_indirect(i) : first_on_surface ? s.indirect : dvec3(0);
    s.volume_indirect = s.indirect - s.surface_indirect;
    deliver(p_.request[i], s, first_on_surface);
  }

  void deliver(size_t request, PathSample& s, bool surface_first) {
    s.direct = s.background + s.emission + s.single + s.surface;
    const double limited = limit_indirect(c_.indirect_limit, s.indirect, counters_.limited);
    for (size_t g = 0; g < found_.size(); ++g) {
      const dvec3 direct = found_[g].direct, indirect = limited * found_[g].indirect;
      group_values_[3 * g] = direct + indirect;
      group_values_[3 * g + 1] = direct;
      group_values_[3 * g + 2] = indirect;
      // What was replaced leaves rounding behind.
      group_values_[3 * found_.size() + g] =
          glm::max(direct + aimed_[g].direct, 0.0) + glm::max(indirect + limited * aimed_[g].indirect, 0.0);
    }
    s.groups = group_values_.data();
    s.volume_indirect *= limited;
    s.surface_indirect *= limited;
    s.beauty = s.direct + s.indirect;
    const dvec3& left = s.transmittance;
    s.transmitted = c_.plan.chromatic ? (left.x + left.y + left.z) / 3 : left.x;
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
  WorldPaths& w_;
  MediaFlights flights_;
  CameraRays camera_rays_;
  std::optional<FlightEmission> emission_;
  std::unique_ptr<CameraSplits> splits_;
  std::optional<NearFlights> near_flights_;
  std::unique_ptr<BallSamples> balls_;
  std::optional<SurfaceEvents> surfaces_;
  std::optional<GroupLights> group_lights_;
  std::optional<PathRecorder> recorder_;
  struct FoundLight {
    dvec3 direct{0}, indirect{0};
  };
  std::vector<FoundLight> found_;    // by light group, of the path that ends
  std::vector<FoundLight> aimed_;    // likewise: what GroupLights add to it
  std::vector<dvec3> group_values_;  // PathSample::groups
  size_t next_ = 0;
  std::vector<size_t> free_;
  std::array<bool, kPool> alive_{};
};

}  // namespace

void trace_paths(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
                 PathCounters& counters) {
  Wavefront(context, requests, sink, counters).run();
}

}  // namespace brume
