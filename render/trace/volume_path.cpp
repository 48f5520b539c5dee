#include "render/trace/volume_path.h"

#include <algorithm>
#include <tuple>
#include <vector>

#include "render/trace/near_light.h"
#include "render/trace/path_layers.h"
#include "render/trace/rules.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

/// What one instantiation of the loop models.
struct Features {
  Plan::Media media;
  bool light_sampling, finite_lights, surfaces, emission;
  constexpr bool any_media() const { return media != Plan::Media::kNone; }
  constexpr bool chromatic() const { return media == Plan::Media::kChromatic; }
};

double mean(const dvec3& v) {
  return (v.x + v.y + v.z) / 3.0;
}

/// Weight of a path. In chromatic media it is sampled by one hero channel, and each channel's own probability of the
/// same choices is carried along: dividing by their mean is the balance heuristic over the channels
/// (docs/methods.md, Spectral tracking), so that no channel's weight runs away. Normalised after each event: the mean
/// is 1.
struct Throughput {
  dvec3 weight{1};
  dvec3 pdf{1};
  int hero = 0;

  void event(const dvec3& factor, const dvec3& probability) {
    weight *= factor;
    pdf *= probability;
    const double m = mean(pdf);
    weight /= m;
    pdf /= m;
  }
};

template <Features F>
class PathTracer {
 public:
  PathTracer(const PathContext& context, std::span<const Medium> media, double time, Rng& rng, PathCounters& counters,
             PathSample& sample, PathRecord* record)
      : c_(context), media_(media), time_(time), rng_(rng), counters_(counters), s_(sample), record_(record) {}

  void trace(const Ray& camera_ray) {
    ++counters_.paths;
    if constexpr (F.any_media()) record_camera_ray(c_, media_, camera_ray, rng_, s_);
    if constexpr (F.chromatic()) throughput_.hero = std::min(2, static_cast<int>(3 * rng_.uniform()));
    ray_ = camera_ray;
    eye_ = camera_ray.o;
    while (step()) {
    }
    counters_.longest = std::max(counters_.longest, events_);
    limit_indirect(c_.indirect_limit, s_.indirect, counters_.limited);
    s_.beauty = s_.direct + s_.indirect;
    if (record_) finish_record();
  }

 private:
  enum class Source { kBackground, kEmission, kSurface };

  /// Adds radiance found after `events` events of the path (docs/methods.md, Direct and indirect light).
  void deposit(const dvec3& radiance, uint64_t events, Source source) {
    const dvec3 L = throughput_.weight * radiance;
    if (!is_direct(events)) {
      s_.indirect += L;
      return;
    }
    s_.direct += L;
    if (events == 1)
      (first_event_on_surface_ ? s_.surface : s_.single) += L;
    else
      (source == Source::kEmission ? s_.emission : source == Source::kSurface ? s_.surface : s_.background) += L;
  }

  /// One flight and the event at its end; false when the path has ended.
  bool step() {
    // What bounds the flight.
    double t_max = kFar;
    const FiniteLight* light = nullptr;
    if constexpr (F.finite_lights) std::tie(light, t_max) = c_.lights->nearest(ray_, t_max, events_ == 0);
    std::optional<SurfaceHit> hit;
    if constexpr (F.surfaces) {
      hit = c_.surfaces->intersect(ray_, t_max);
      if (hit) {
        t_max = hit->t;
        light = nullptr;
      }
    }

    if constexpr (F.any_media()) {
      if constexpr (F.light_sampling)
        for (const NearLight& near : c_.plan.near_lights) gather_near(near, t_max);
      const Medium* medium = nullptr;
      const double t = fly(t_max, medium);
      if (medium) return scatter(*medium, t);
    } else if constexpr (F.emission) {
      glow(0, t_max);
    }
    if constexpr (F.surfaces)
      if (hit) return meet_surface(*hit);

    if (events_ == 0) s_.transmittance = throughput_.weight;
    if (light) {
      const double pdf_light =
          F.light_sampling ? c_.lights->choice_probability(*light, ray_.o) * light->pdf(ray_, t_max) : 0;
      if (straight_ && pdf_light > 0) return false;
      const double share = left_in_medium_ ? far_share(c_.plan.near_lights, light, ray_.o) : 1.0;
      deposit(light->radiance(ray_, t_max) * (share * weight_against(pdf_light)), events_, Source::kBackground);
    } else {
      escape();
    }
    return false;
  }

  /// What far_share leaves out, of light scattered once along this flight: at a point chosen by its distance from the
  /// light.
  void gather_near(const NearLight& near, double t_max) {
    double t0 = t_max, t1 = 0;
    for (const Medium& m : media_) {
      const Medium::Sphere ball = m.bounding_sphere();
      const double middle = glm::dot(ball.centre - ray_.o, ray_.d), off = glm::distance(ray_.at(middle), ball.centre);
      if (!(off < ball.radius)) continue;
      const double half = std::sqrt(ball.radius * ball.radius - off * off);
      t0 = std::min(t0, std::max(0.0, middle - half));
      t1 = std::max(t1, std::min(t_max, middle + half));
    }
    const NearSegment segment(near, ray_, t0, t1);
    if (!(t1 > t0) || !(rng_.uniform() < segment.worth())) return;
    const auto [t, pdf] = segment.sample(rng_.uniform());
    const dvec3 p = ray_.at(t);
    const LightSample sample = near.light->sample(p, pair());
    if (!(sample.pdf > 0)) return;
    dvec3 scattered(0);
    for (const Medium& m : media_) {
      const double density = m.density(m.to_local(p));
      counters_.tracking.look_up();
      if (density > 0)
        scattered += m.coefficients().sigma_t * (density * m.phase().value(glm::dot(ray_.d, sample.wi))) * m.albedo(p);
    }
    const double part = (1 - near.far_part(p)) / (pdf * segment.worth() * sample.pdf);
    const dvec3 L = arriving(scattered * sample.radiance * part, Ray{p, sample.wi}, sample.distance, near.light);
    if (L != dvec3(0)) deposit(dimmed(L, ray_, t), events_ + 1, Source::kBackground);
  }

  /// MIS weight of light found by direction sampling, against light sampling.
  double weight_against(double pdf_light) const {
    return !F.light_sampling || events_ == 0 || specular_ ? 1.0 : balance(pdf_direction_, pdf_light);
  }

  void escape() {
    for (const InfiniteLight* light : c_.lights->infinite()) {
      if (events_ == 0 && !light->visible()) continue;
      const dvec3 radiance = light->radiance(ray_.d);
      if (radiance == dvec3(0)) continue;
      const double share = F.light_sampling ? c_.lights->choice_probability(*light, ray_.o) : 0.0;
      if (straight_ && share > 0) continue;
      deposit(radiance * weight_against(share > 0 ? share * light->pdf(ray_.d) : 0.0), events_, Source::kBackground);
    }
  }

  /// Adds the emission between two points of the flight. Scattering blurs: coarser strata are enough after it.
  void glow(double t0, double t1) {
    if constexpr (F.emission) {
      dvec3 sum(0);
      for (const EmissionField& field : c_.emissions)
        sum += field.integrate(ray_, t0, t1, emission_stride(events_), time_, rng_);
      if (sum != dvec3(0)) deposit(sum, events_, Source::kEmission);
    }
  }

  /// The next real collision before t_max, and whose it is.
  double fly(double t_max, const Medium*& medium) {
    TrackingCounters& counters = counters_.tracking;
    if constexpr (F.media == Plan::Media::kOneGrey) {
      const double t = sample_collision(media_[0], media_[0].to_local(ray_), t_max, rng_, counters);
      if (t >= 0) medium = &media_[0];
      glow(0, medium ? t : t_max);
      return t;
    } else if constexpr (F.media == Plan::Media::kManyGrey) {
      // Collisions with each medium are independent Poisson processes; the first of all is the path's.
      double first = t_max;
      for (const Medium& m : media_) {
        const double t = sample_collision(m, m.to_local(ray_), first, rng_, counters);
        if (t >= 0) {
          first = t;
          medium = &m;
        }
      }
      glow(0, first);
      return first;
    } else {
      return fly_chromatic(t_max, medium);
    }
  }

  /// The tentative collisions of all media in order; at each the hero channel decides, and all channels keep account.
  double fly_chromatic(double t_max, const Medium*& medium) {
    TrackingCounters& counters = counters_.tracking;
    struct Stream {
      const Medium* medium;
      TentativeCollisions points;
      TentativeCollision next;
    };
    static thread_local std::vector<Stream> streams;
    streams.clear();
    for (const Medium& m : media_) {
      Stream s{&m, {m, m.to_local(ray_), t_max, rng_}, {}};
      if (s.points.next(s.next, rng_, counters)) streams.push_back(s);
    }
    double before = 0;
    while (!streams.empty()) {
      const auto stream = std::min_element(streams.begin(), streams.end(),
                                           [](const Stream& a, const Stream& b) { return a.next.t < b.next.t; });
      const TentativeCollision point = stream->next;
      glow(before, point.t);
      before = point.t;
      const dvec3 real = stream->medium->extinction_ratio() * std::min(1.0, point.density / point.majorant);
      if (rng_.uniform() < real[throughput_.hero]) {
        throughput_.event(real, real);
        ++counters.collisions;
        medium = stream->medium;
        return point.t;
      }
      throughput_.event(dvec3(1) - real, dvec3(1) - real);
      if (!stream->points.next(stream->next, rng_, counters)) streams.erase(stream);
    }
    glow(before, t_max);
    return -1;
  }

  /// A real collision in a medium.
  bool scatter(const Medium& medium, double t) {
    const Ray flight = ray_;
    ray_.o = ray_.at(t);
    const dvec3 albedo = medium.albedo(ray_.o);
    if (record_ && events_ < 2) record_event(flight, t);
    if (events_ == 0)
      flash_ = record_first_scatter(c_, media_, medium, eye_, ray_.o, ray_.d, throughput_.weight, albedo, s_);
    throughput_.weight *= albedo;  // absorption by weight, not by chance
    const PhaseFunction& phase = medium.phase();
    if constexpr (F.light_sampling) {
      const double choice = rng_.uniform();
      const dvec3 d = ray_.d;
      const dvec3 L = sampled_light(
          ray_.o, choice, pair(),
          [&](const dvec3& wi) {
            const double p = phase.value(glm::dot(d, wi));
            return std::pair(dvec3(p), p);
          },
          true, false, nullptr, true);
      deposit(L, events_ + 1, Source::kBackground);
    }
    if (!survives()) return false;
    const dvec3 d = phase.sample(ray_.d, pair());
    pdf_direction_ = phase.value(glm::dot(ray_.d, d));
    ray_.d = d;
    specular_ = straight_ = false;
    sampled_light_ = left_in_medium_ = true;
    if (record_ && events_ < 2) (events_ == 0 ? record_->direction_1 : record_->direction_2) = vec3(d);
    ++events_;
    return true;
  }

  bool meet_surface(const SurfaceHit& hit) {
    const SurfaceSettings& settings = c_.surfaces->settings(hit.surface);
    const dvec3 p = ray_.at(hit.t), wo = -ray_.d;
    const bool front = glm::dot(wo, hit.normal) > 0;
    if (events_ == 0 && settings.role == "holdout") {
      s_.transmittance = throughput_.weight;  // a hole: nothing is there, and alpha says so
      return false;
    }
    const Bsdf bsdf = c_.surfaces->bsdf(hit);
    // Light takes the shading normal's angles but the geometry's side: what would leak through is left out.
    const dvec3 outside = front ? hit.normal : -hit.normal, smooth = front ? hit.shading : -hit.shading;
    const Frame frame(glm::dot(wo, smooth) > 1e-4 ? smooth : outside);
    const auto leaks = [&](const dvec3& wi, double local_z) { return glm::dot(wi, outside) * local_z < 0; };
    const auto to_local = [&](const dvec3& w) {
      return dvec3(glm::dot(w, frame.x), glm::dot(w, frame.y), glm::dot(w, frame.z));
    };
    const dvec3 wo_local = to_local(wo);
    const auto scattering = [&](const dvec3& wi) {
      const dvec3 wi_local = to_local(wi);
      if (leaks(wi, wi_local.z)) return std::pair(dvec3(0), 0.0);
      return std::pair(bsdf.value(wo_local, wi_local, !front), bsdf.pdf(wo_local, wi_local, !front));
    };
    if (events_ == 0 && settings.role == "shadow_catcher") {
      if constexpr (F.light_sampling) {
        const double choice = rng_.uniform();
        const dvec2 u = pair();
        const dvec3 off = Surfaces::leave(hit, p, wo);
        s_.catcher += throughput_.weight * sampled_light(off, choice, u, scattering, true, true);
        s_.catcher_unshadowed += throughput_.weight * sampled_light(off, choice, u, scattering, false, true);
      }
      // Unseen itself: the same path goes on behind it.
      ray_.o = Surfaces::leave(hit, p, ray_.d);
      return true;
    }
    if (front && settings.radiance != dvec3(0)) {
      const double pdf_light = [&] {
        if (!F.light_sampling) return 0.0;
        const MeshLight& light = c_.lights->mesh(c_.surfaces->light_of(hit.surface));
        return c_.lights->choice_probability(light, ray_.o) * light.pdf(hit.t, glm::dot(wo, hit.normal));
      }();
      if (!straight_ || pdf_light == 0)
        deposit(settings.radiance * weight_against(pdf_light), events_, Source::kSurface);
    }
    if (events_ == 0) {
      first_event_on_surface_ = true;
      s_.albedo = bsdf.albedo;
      s_.normal = frame.z;
      s_.depth = glm::distance(eye_, p);
      s_.position = p + c_.world_shift;
    }
    if constexpr (F.light_sampling) {
      if (!bsdf.delta()) {
        const double choice = rng_.uniform();
        const dvec2 u = pair();
        // Lights on either side of the surface are reached from that side.
        const dvec3 L = sampled_light(p, choice, u, scattering, true, false, &hit);
        deposit(L, events_ + 1, Source::kSurface);
      }
    }
    if (!survives()) return false;
    const dvec2 u = pair();
    Bsdf::Sample out;
    if (!bsdf.sample(wo_local, !front, {u.x, u.y, rng_.uniform()}, out)) return false;
    throughput_.weight *= out.weight;
    if (throughput_.weight == dvec3(0)) return false;
    pdf_direction_ = out.pdf;
    specular_ = bsdf.delta();
    // Light sampling sees past straight transmissions alone.
    const bool seen_through = settings.shadow == "straight" && out.wi.z * wo_local.z < 0;
    straight_ = seen_through && sampled_light_;
    sampled_light_ = !specular_ || straight_;
    left_in_medium_ = false;
    ray_.d = glm::normalize(frame.to_world(out.wi));
    if (leaks(ray_.d, out.wi.z)) return false;
    ray_.o = Surfaces::leave(hit, p, ray_.d);
    ++events_;
    return true;
  }

  dvec2 pair() {
    const double x = rng_.uniform();
    return {x, rng_.uniform()};
  }

  /// Russian roulette and the cap on events; false where the path ends.
  bool survives() {
    if (events_ + 1 >= static_cast<uint64_t>(c_.roulette_start)) {
      const double chance = survival(max_component(throughput_.weight));
      if (chance < 1) {
        if (!(rng_.uniform() < chance)) return false;
        throughput_.weight /= chance;
      }
    }
    if (events_ + 1 >= static_cast<uint64_t>(c_.max_events)) {
      ++counters_.capped_paths;
      counters_.capped_throughput += max_component(throughput_.weight);
      return false;
    }
    return true;
  }

  /// Next-event estimation: one light, one shadow ray. `scattering` gives value (times cosine) and sampling density of
  /// a direction. @param from  the surface that p lies on, which its shadow ray leaves
  template <class Scattering>
  dvec3 sampled_light(const dvec3& p, double choice, const dvec2& u, const Scattering& scattering, bool shadowed = true,
                      bool only_technique = false, const SurfaceHit* from = nullptr, bool in_medium = false) {
    const LightSample light = c_.lights->sample(p, choice, u);
    if (record_ && events_ == 0) {
      record_->light_1 = static_cast<float>(light.index);
      record_->light_uv_1 = vec2(u);
    }
    if (!(light.pdf > 0)) return dvec3(0);
    const auto [value, pdf] = scattering(light.wi);
    const double weight = light.delta || only_technique ? 1.0 : balance(light.pdf, pdf);
    const double share = in_medium ? far_share(c_.plan.near_lights, light.light, p) : 1.0;
    const dvec3 unoccluded = light.radiance * value * (share * weight / light.pdf);
    if (unoccluded == dvec3(0) || !shadowed) return unoccluded;
    const Ray shadow{from ? Surfaces::leave(*from, p, light.wi) : p, light.wi};
    bool straight = false;
    const dvec3 left = arriving(unoccluded, shadow, light.distance, light.light, &straight);
    if (record_ && events_ == 0)
      record_->light_transmittance_1 = static_cast<float>(luminance(left) / luminance(unoccluded));
    return straight ? left / weight : left;  // behind straight shadows no other technique finds it
  }

  /// Light that comes through to a point from a sample of a light.
  /// @param straight  set where it passes surfaces with straight shadows
  dvec3 arriving(const dvec3& unoccluded, const Ray& shadow, double distance, const Light* from,
                 bool* straight = nullptr) {
    if (unoccluded == dvec3(0)) return unoccluded;
    if constexpr (F.finite_lights)
      if (c_.lights->blocked(shadow, distance, from)) return dvec3(0);
    dvec3 passed = unoccluded;
    if constexpr (F.surfaces) {
      const Surfaces::Passage passage = c_.surfaces->passage(shadow, distance * (1.0 - 1e-4));
      if (passage.light == dvec3(0)) return dvec3(0);
      passed *= passage.light;
      if (straight) *straight = passage.straight;
    }
    return dimmed(passed, shadow, distance);
  }

  /// Light after its way through the media.
  dvec3 dimmed(const dvec3& unoccluded, const Ray& shadow, double distance) {
    if constexpr (F.media == Plan::Media::kOneGrey) {
      return unoccluded *
             estimate_transmittance(media_[0], media_[0].to_local(shadow), distance, rng_, counters_.tracking);
    } else if constexpr (F.any_media()) {
      dvec3 product = unoccluded;
      for (const Medium& m : media_) {
        if (F.chromatic() && m.chromatic())
          product *= estimate_chromatic_transmittance(m, m.to_local(shadow), distance, rng_, counters_.tracking);
        else
          product *= estimate_transmittance(m, m.to_local(shadow), distance, rng_, counters_.tracking);
        if (product == dvec3(0)) break;
      }
      return product;
    }
    return unoccluded;
  }

  // ---- per-sample records

  void record_event(const Ray& flight, double t) {
    double tau = 0;
    for (const Medium& m : media_) tau += optical_depth(m, m.to_local(flight), t);
    (events_ == 0 ? record_->flight_1 : record_->flight_2) = static_cast<float>(-std::expm1(-tau));
    (events_ == 0 ? record_->position_1 : record_->position_2) = vec3(flight.at(t) + c_.world_shift);
    record_->flags += events_ == 0 ? 1.0f : first_event_on_surface_ ? 0.0f : 2.0f;
  }

  void finish_record() {
    PathRecord& r = *record_;
    r.surface_gradient = vec3(s_.gradient);
    r.gradient_1 = vec3(s_.gradient_first_scatter);
    r.albedo = vec3(s_.albedo);
    r.density_1 = static_cast<float>(s_.scatter_density);
    r.normal = vec3(s_.normal);
    if (first_event_on_surface_) {
      r.flags += 4;
      r.position_1 = vec3(s_.position);
    }
    if (s_.coverage > 0) r.flags += 8;
    r.unscattered = vec3(s_.background + s_.emission + s_.surface);
    r.single = vec3(s_.single);
    r.indirect = vec3(s_.indirect);
  }

 public:
  /// The lamp's part of the flash image, without its intensity.
  const dvec3& flash() const { return flash_; }

 private:
  const PathContext& c_;
  std::span<const Medium> media_;
  double time_;  // of the shutter
  Rng& rng_;
  PathCounters& counters_;
  PathSample& s_;
  PathRecord* record_;

  Ray ray_;
  dvec3 eye_{0};
  Throughput throughput_;
  double pdf_direction_ = 1;
  bool specular_ = false;
  // sampled_light_: since the last vertex that sampled a light, the path has hit at most surfaces that shadow rays pass
  // straight through; straight_: and at least one of them.
  bool sampled_light_ = false, straight_ = false;
  bool first_event_on_surface_ = false;
  bool left_in_medium_ = false;  ///< the last vertex is a scattering in a medium
  uint64_t events_ = 0;          // real scatterings and surface bounces so far; null collisions are none
  dvec3 flash_{0};
};

template <Features F>
void trace_paths(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
                 PathCounters& counters) {
  static thread_local std::vector<Medium> moved;
  counters.tracking.stop = context.stop;
  for (size_t i = 0; i < requests.size(); ++i) {
    const PathRequest& request = requests[i];
    Rng rng(request.key);
    std::span<const Medium> media = context.media;
    if (context.plan.moving_media) {
      moved.clear();
      for (const Medium& m : context.media) moved.push_back(m.moves() ? m.at_time(request.time) : m);
      media = moved;
    }
    PathSample sample;
    PathTracer<F> tracer(context, media, request.time, rng, counters, sample, request.record);
    tracer.trace(request.ray);
    if (context.plan.flash) sample.flash = flash_image(sample.direct, context.flash.intensity, tracer.flash());
    sink(i, sample);
  }
}

template <Plan::Media kMedia, bool kSurfaces, bool kEmission>
TracePaths select_lights(const Plan& plan) {
  // Meshes may be lights, and catchers gather theirs: with surfaces the loop is always ready for finite lights.
  if constexpr (kSurfaces) {
    return plan.light_sampling ? trace_paths<Features{kMedia, true, true, true, kEmission}>
                               : trace_paths<Features{kMedia, false, true, true, kEmission}>;
  } else {
    if (plan.light_sampling)
      return plan.finite_lights ? trace_paths<Features{kMedia, true, true, false, kEmission}>
                                : trace_paths<Features{kMedia, true, false, false, kEmission}>;
    return plan.finite_lights ? trace_paths<Features{kMedia, false, true, false, kEmission}>
                              : trace_paths<Features{kMedia, false, false, false, kEmission}>;
  }
}

template <Plan::Media kMedia>
TracePaths select_rest(const Plan& plan) {
  if (plan.surfaces)
    return plan.emission ? select_lights<kMedia, true, true>(plan) : select_lights<kMedia, true, false>(plan);
  return plan.emission ? select_lights<kMedia, false, true>(plan) : select_lights<kMedia, false, false>(plan);
}

}  // namespace

TracePaths select_general_loop(const Plan& plan) {
  switch (plan.media) {
    case Plan::Media::kNone:
      return select_rest<Plan::Media::kNone>(plan);
    case Plan::Media::kOneGrey:
      return select_rest<Plan::Media::kOneGrey>(plan);
    case Plan::Media::kManyGrey:
      return select_rest<Plan::Media::kManyGrey>(plan);
    default:
      return select_rest<Plan::Media::kChromatic>(plan);
  }
}

}  // namespace brume
