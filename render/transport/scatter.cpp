#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/transport/scatter.cpp"
#include "render/transport/scatter.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>

#include "render/transport/estimator.h"
#include "render/transport/world_paths.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/vector_math.h"

/// A function of the numbers of the first lanes, one after the other.
template <class Function>
HWY_INLINE V each_lane(V v, size_t lanes, Function&& function) {
  HWY_ALIGN float x[hn::MaxLanes(D())];
  hn::Store(v, D(), x);
  for (size_t lane = 0; lane < lanes; ++lane) x[lane] = static_cast<float>(function(static_cast<double>(x[lane])));
  return hn::Load(D(), x);
}

/// Of each lane, where new directions aim at fields that emit.
template <bool kAims>
struct LaneCones {};
template <>
struct LaneCones<true> {
  std::array<FieldCones, hn::MaxLanes(D())> of;
};

/// The collisions of as many paths as there are lanes. @tparam kAims  LaneScene::aims_at_fields
template <bool kAims>
class Collisions {
 public:
  HWY_INLINE Collisions(const LaneScene& scene, PathStates& paths, const SlotList& slots, size_t begin)
      : scene_(scene),
        paths_(paths),
        slots_(slots.slot.data() + begin),
        valid_(static_cast<uint32_t>(std::min(hn::Lanes(D()), slots.count - begin))),
        valid_bits_(valid_ >= 32 ? ~0u : (1u << valid_) - 1),
        everyone_(mask_of(valid_bits_)),
        slot_(hn::LoadU(DI(), slots_)),
        rng_{get_u(paths.generator[0]), get_u(paths.generator[1]), get_u(paths.generator[2]),
             get_u(paths.generator[3])},
        g_(std::abs(scene.g)) {
    // Angles are measured from the phase function's peak: a negative g is the positive one, mirrored.
    peak_ = gather3(paths.d, slot_) * (scene.g < 0 ? -1.0f : 1.0f);
    throughput_ = gather3(paths.throughput, slot_) * albedo();
    if constexpr (kAims)
      for (size_t lane = 0; lane < valid_; ++lane) cones_.of[lane] = scene.lights->field_cones(position(lane));
  }

  /// Samples one light. @param shadows  gets those that are worth a shadow ray
  HWY_INLINE void sample_light(SlotList& shadows) {
    const V zero = hn::Zero(D()), one = set(1.0f);
    const size_t lights = scene_.lights ? scene_.lights->choice(scene_.samples_fields).count()
                                        : scene_.sun_count + (scene_.environment != nullptr);
    if (lights == 0) return;
    const V choice = lights > 1 || scene_.samples_fields ? rng_.uniform(everyone_) : zero;
    const V u1 = rng_.uniform(everyone_), u2 = rng_.uniform(everyone_);
    Sample s{{zero, zero, one}, zero3(), zero, hn::FirstN(D(), 0)};
    const M chosen = sample_suns(choice, u1, u2, s);
    if (scene_.environment || scene_.lights) sample_others(valid_bits_ & ~bits_of(chosen), choice, u1, u2, s);
    const V phase = phase_towards(s.wi);
    const V mis = hn::IfThenElse(s.delta, one, s.pdf / (s.pdf + density(phase, s.wi)));
    const V factor = hn::IfThenElseZero(s.pdf > zero, phase * mis / s.pdf);
    const V3 contribution = throughput_ * s.light * factor;
    scatter3(contribution, paths_.contribution, slot_);
    put(one, paths_.transmittance);
    if (scene_.keeps_local) {
      scatter3(transform(scene_.local_from_world, s.wi), paths_.shadow.d, slot_);
      if (scene_.grouped) put(mis, paths_.mis);
    } else {
      scatter3(s.wi, paths_.wi, slot_);
      put(mis, paths_.mis);
    }
    push(bits_of(max_component(contribution) > zero), shadows);
  }

  /// Counts the event. Russian roulette, as survival() has it, and the cap on events. Returns who goes on.
  HWY_INLINE M survive(uint64_t& capped_paths, double& capped_throughput) {
    const D d;
    const DI di;
    const DU du;
    const VU events = get_u(paths_.events) + 1;
    hn::ScatterIndex(events, du, paths_.events.data(), slot_);
    const auto more_than = [&](int count) { return hn::RebindMask(d, hn::BitCast(di, events) > count - 1); };
    const V one = set(1.0f);
    const V chance = hn::Min(hn::Max(max_component(throughput_), set(static_cast<float>(kLeastSurvival))), one);
    const M plays = hn::And(everyone_, hn::And(more_than(scene_.roulette_start), chance < one));
    M lives = everyone_;
    if (!hn::AllFalse(d, plays)) {
      const V u = rng_.uniform(plays);
      lives = hn::AndNot(hn::And(plays, u >= chance), everyone_);
      const V boost = hn::IfThenElse(plays, one / chance, one);
      throughput_ = throughput_ * boost;
    }
    const M cut = hn::And(lives, more_than(scene_.max_events));
    if (hn::AllFalse(d, cut)) return lives;
    HWY_ALIGN float carried[hn::MaxLanes(D())];
    hn::Store(max_component(throughput_), d, carried);
    for (uint32_t left = bits_of(cut); left; left &= left - 1) {
      ++capped_paths;
      capped_throughput += static_cast<double>(carried[std::countr_zero(left)]);
    }
    return hn::AndNot(cut, lives);
  }

  /// Draws a new direction, and writes the paths back. @param alive  gets those of `lives`
  HWY_INLINE void turn(M lives, SlotList& alive) {
    const DU du;
    const V one = set(1.0f), xi = rng_.uniform(everyone_);
    const V one_minus = scene_.phase
                            ? each_lane(xi, valid_, [&](double x) { return 1.0 - scene_.phase->sample_cosine(x); })
                            : sample_henyey_greenstein(g_, xi);
    const V sin_theta = hn::Sqrt(hn::Max(one_minus * (2.0f - one_minus), hn::Zero(D())));
    const SinCosV phi = sincos_2pi(rng_.uniform(everyone_));
    V3 turned = around(peak_, sin_theta * phi.cos, sin_theta * phi.sin, one - one_minus);
    if constexpr (kAims)
      aim(turned);
    else
      put(phase_towards(turned), paths_.pdf);
    scatter3(turned, paths_.d, slot_);
    if (scene_.keeps_local) scatter3(transform(scene_.local_from_world, turned), paths_.flight.d, slot_);
    scatter3(throughput_, paths_.throughput, slot_);
    const VU generator[] = {rng_.s0, rng_.s1, rng_.s2, rng_.s3};
    for (size_t k = 0; k < 4; ++k) hn::ScatterIndex(generator[k], du, paths_.generator[k].data(), slot_);
    push(bits_of(lives), alive);
  }

 private:
  struct Sample {
    V3 wi, light;
    V pdf;
    M delta;
  };

  template <class Column>
  HWY_INLINE V get(const Column& column) const {
    return hn::GatherIndex(D(), column.data(), slot_);
  }
  template <class Column>
  HWY_INLINE VU get_u(const Column& column) const {
    return hn::GatherIndex(DU(), column.data(), slot_);
  }
  template <class Column>
  HWY_INLINE void put(V v, Column& column) const {
    hn::ScatterIndex(v, D(), column.data(), slot_);
  }
  HWY_INLINE void push(uint32_t lanes, SlotList& list) const {
    for (lanes &= valid_bits_; lanes; lanes &= lanes - 1)
      list.push(static_cast<size_t>(slots_[std::countr_zero(lanes)]));
  }

  HWY_INLINE V phase_towards(const V3& wi) const {
    const V one_minus = one_minus_cos(peak_, wi);
    if (!scene_.phase) return henyey_greenstein(g_, one_minus);
    return each_lane(one_minus, valid_, [&](double x) { return scene_.phase->value(1.0 - x); });
  }

  /// The density of a new direction. @param phase  of the phase function
  HWY_INLINE V density(V phase, const V3& wi) const {
    if constexpr (kAims) {
      Lanes3 d;
      d.store(wi);
      return mixed(phase, [&](size_t lane) { return cones_.of[lane].pdf(dvec3(d[lane])); });
    }
    return phase;
  }

  /// The density of a new direction. @param cones  of the lane's cones
  template <class Density>
  HWY_INLINE V mixed(V phase, const Density& cones) const {
    HWY_ALIGN Lanes pdf;
    hn::Store(phase, D(), pdf);
    for (size_t lane = 0; lane < valid_; ++lane)
      pdf[lane] = static_cast<float>(cones_.of[lane].mixed(static_cast<double>(pdf[lane]), cones(lane)));
    return hn::Load(D(), pdf);
  }

  /// Turns some directions towards fields that emit. Their density is that of the direction drawn: rounded to floats
  /// it may lie outside of a narrow cone, and would weigh too much.
  HWY_INLINE void aim(V3& turned) {
    HWY_ALIGN Lanes aims, choice, x, y;
    for (float* const u : {aims, choice, x, y}) hn::Store(rng_.uniform(everyone_), D(), u);
    Lanes3 d;
    d.store(turned);
    std::array<double, hn::MaxLanes(D())> in_cones{};
    for (size_t lane = 0; lane < valid_; ++lane) {
      const FieldCones& cones = cones_.of[lane];
      dvec3 drawn(d[lane]);
      if (static_cast<double>(aims[lane]) < cones.share()) {
        drawn = cones.sample(static_cast<double>(choice[lane]), dvec2(x[lane], y[lane]));
        d.set(lane, vec3(drawn));
      }
      in_cones[lane] = cones.pdf(drawn);
    }
    turned = d.load();
    const V phase = phase_towards(turned), pdf = mixed(phase, [&](size_t lane) { return in_cones[lane]; });
    throughput_ = throughput_ * (phase / pdf);
    put(pdf, paths_.pdf);
  }

  HWY_INLINE dvec3 position(size_t lane) const {
    const auto s = static_cast<size_t>(slots_[lane]);
    if (!scene_.keeps_local) return scene_.world->ray[s].o;
    return scene_.medium->to_world(dvec3(paths_.flight.o[s]));
  }

  HWY_INLINE V3 albedo() const {
    if (!scene_.coloured) return set3(scene_.albedo);
    Lanes3 rgb;
    const auto at = [&](size_t lane) {
      if (!scene_.medium->instances()) return scene_.medium->albedo(position(lane));
      const int32_t number = scene_.world->instance[static_cast<size_t>(slots_[lane])];
      return scene_.medium->albedo(static_cast<size_t>(number), position(lane));
    };
    for (size_t lane = 0; lane < valid_; ++lane) rgb.set(lane, vec3(at(lane)));
    return rgb.load();
  }

  /// Samples the suns in the lanes that choose one. Returns which.
  HWY_INLINE M sample_suns(V choice, V u1, V u2, Sample& s) const {
    const V one = set(1.0f);
    const SinCosV phi = sincos_2pi(u2);
    M chosen = hn::FirstN(D(), 0);
    for (size_t k = 0; k < scene_.sun_count; ++k) {
      const LaneScene::SunLight& sun = scene_.suns[k];
      const M rest = mask_of(k + 1 == scene_.sun_count && !scene_.environment ? ~0u : 0u);
      const M mine = hn::AndNot(chosen, hn::Or(choice < sun.share_end, rest));
      chosen = hn::Or(chosen, mine);
      const V h = u1 * sun.one_minus_cos;
      const V sine = hn::Sqrt(hn::Max(h * (2.0f - h), hn::Zero(D())));
      const V3 wi = set3(sun.x) * (sine * phi.cos) + set3(sun.y) * (sine * phi.sin) + set3(sun.z) * (one - h);
      s.wi = select(mine, wi, s.wi);
      s.light = select(mine, set3(sun.radiance), s.light);
      s.pdf = hn::IfThenElse(mine, set(sun.pdf * sun.share), s.pdf);
      if (sun.delta) s.delta = hn::Or(s.delta, mine);
      if (scene_.grouped)
        for (uint32_t left = bits_of(mine) & valid_bits_; left; left &= left - 1)
          note_group(std::countr_zero(left), sun.group);
    }
    return chosen;
  }

  /// Samples the environment, or any light where the choice depends on the point, lane by lane.
  HWY_INLINE void sample_others(uint32_t lanes, V choice, V u1, V u2, Sample& s) {
    const D d;
    HWY_ALIGN Lanes c, x, y, pdf;
    Lanes3 wi, light;
    hn::Store(choice, d, c);
    hn::Store(u1, d, x);
    hn::Store(u2, d, y);
    hn::Store(s.pdf, d, pdf);
    wi.store(s.wi);
    light.store(s.light);
    uint32_t delta = 0;
    for (uint32_t left = lanes; left; left &= left - 1) {
      const auto lane = static_cast<size_t>(std::countr_zero(left));
      const LightSample sample = sample_other(lane, static_cast<double>(c[lane]), dvec2(x[lane], y[lane]));
      delta |= static_cast<uint32_t>(sample.delta) << lane;
      wi.set(lane, vec3(sample.wi));
      light.set(lane, vec3(sample.radiance));
      pdf[lane] = static_cast<float>(sample.pdf);
    }
    s = {wi.load(), light.load(), hn::Load(d, pdf), hn::Or(s.delta, mask_of(delta))};
  }

  /// Keeps the light group of a lane's sample. @param light  null for a sun or the environment
  void note_group(size_t lane, size_t group, const Light* light = nullptr) const {
    const auto s = static_cast<size_t>(slots_[lane]);
    scene_.world->sampled_group[s] = group;
    scene_.world->sampled_light[s] = light;
  }

  LightSample sample_other(size_t lane, double choice, const dvec2& u) const {
    const auto s = static_cast<size_t>(slots_[lane]);
    if (!scene_.lights) {
      LightSample sample = scene_.environment->sample(u);
      sample.delta = false;
      sample.pdf *= static_cast<double>(scene_.environment_share);
      if (scene_.grouped) note_group(lane, scene_.environment->group);
      return sample;
    }
    const dvec3 p = position(lane);
    LightSample sample = scene_.lights->sample_visible(p, choice, u, scene_.samples_fields);
    sample.radiance *= far_share(scene_.near_lights, sample.light, p);
    if (scene_.grouped && sample.light) note_group(lane, sample.light->group, sample.light);
    if (scene_.keeps_local)
      paths_.shadow.end[s] = static_cast<float>(std::min(sample.distance / scene_.unit, 1e30));
    else
      scene_.world->note_light(s, sample, u, paths_.events[s] == 0);
    return sample;
  }

  const LaneScene& scene_;
  PathStates& paths_;
  const int32_t* slots_;
  uint32_t valid_, valid_bits_;
  M everyone_;
  VI slot_;
  Generator rng_;
  float g_;
  V3 peak_ = zero3(), throughput_ = peak_;
  [[no_unique_address]] LaneCones<kAims> cones_;
};

template <bool kAims>
void scatter(const LaneScene& scene, PathStates& paths, SlotList& slots, SlotList& shadows, SlotList& alive,
             uint64_t& capped_paths, double& capped_throughput) {
  slots.pad();
  for (size_t i = 0; i < slots.count; i += hn::Lanes(D())) {
    Collisions<kAims> collisions(scene, paths, slots, i);
    collisions.sample_light(shadows);
    const M lives = collisions.survive(capped_paths, capped_throughput);
    collisions.turn(lives, alive);
  }
}

void Scatter(const LaneScene& scene, PathStates& paths, SlotList& slots, SlotList& shadows, SlotList& alive,
             uint64_t& capped_paths, double& capped_throughput) {
  const auto run = scene.aims_at_fields ? scatter<true> : scatter<false>;
  run(scene, paths, slots, shadows, alive, capped_paths, capped_throughput);
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(Scatter);

void lanes_scatter(const LaneScene& scene, PathStates& paths, SlotList& slots, SlotList& shadows, SlotList& alive,
                   uint64_t& capped_paths, double& capped_throughput) {
  HWY_DYNAMIC_DISPATCH(Scatter)(scene, paths, slots, shadows, alive, capped_paths, capped_throughput);
}

}  // namespace brume
#endif
