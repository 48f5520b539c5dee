#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/lanes/scatter.cpp"
#include "render/lanes/scatter.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>

#include "render/lanes/world_paths.h"
#include "render/trace/rules.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/lanes/vector_math.h"

/// A function of the numbers of the first lanes, one after the other.
template <class Function>
HWY_INLINE V each_lane(V v, size_t lanes, Function&& function) {
  HWY_ALIGN float x[hn::MaxLanes(D())];
  hn::Store(v, D(), x);
  for (size_t lane = 0; lane < lanes; ++lane) x[lane] = static_cast<float>(function(static_cast<double>(x[lane])));
  return hn::Load(D(), x);
}

void Scatter(const LaneScene& scene, PathStates& paths, SlotList& slots, SlotList& shadows, SlotList& alive,
             uint64_t& capped_paths, double& capped_throughput) {
  const D d;
  const DI di;
  const DU du;
  const size_t lanes = hn::Lanes(d);
  slots.pad();
  const V zero = hn::Zero(d), one = set(1.0f);
  for (size_t i = 0; i < slots.count; i += lanes) {
    const VI slot = hn::LoadU(di, slots.slot.data() + i);
    const auto get = [&](const auto& column) { return hn::GatherIndex(d, column.data(), slot); };
    const auto get_u = [&](const auto& column) { return hn::GatherIndex(du, column.data(), slot); };
    const auto put = [&](V v, auto& column) { hn::ScatterIndex(v, d, column.data(), slot); };
    const auto put_u = [&](VU v, auto& column) { hn::ScatterIndex(v, du, column.data(), slot); };
    const auto valid = static_cast<uint32_t>(std::min(lanes, slots.count - i));
    const uint32_t valid_bits = valid >= 32 ? ~0u : (1u << valid) - 1;
    const M everyone = mask_of(valid_bits);

    Generator rng{get_u(paths.s0), get_u(paths.s1), get_u(paths.s2), get_u(paths.s3)};
    const V3 dir{get(paths.dx), get(paths.dy), get(paths.dz)};
    const auto position = [&](size_t lane) {
      const auto s = static_cast<size_t>(slots.slot[i + lane]);
      return scene.world ? scene.world->ray[s].o : scene.medium->to_world(dvec3(paths.ox[s], paths.oy[s], paths.oz[s]));
    };
    // Angles are measured from the phase function's peak: a negative g is the positive one, mirrored.
    const V side = set(scene.g < 0 ? -1.0f : 1.0f);
    const V3 peak{hn::Mul(side, dir.x), hn::Mul(side, dir.y), hn::Mul(side, dir.z)};
    const float g = std::abs(scene.g);
    const auto phase_towards = [&](const V3& wi) {
      const V one_minus = one_minus_cos(peak, wi);
      if (!scene.phase) return phase_value(g, one_minus);
      return each_lane(one_minus, valid, [&](double x) { return scene.phase->value(1.0 - x); });
    };
    V3 albedo{set(scene.albedo[0]), set(scene.albedo[1]), set(scene.albedo[2])};
    if (scene.coloured) {
      HWY_ALIGN float rgb[3][hn::MaxLanes(d)] = {};
      for (size_t lane = 0; lane < valid; ++lane) {
        const vec3 a(scene.medium->albedo(position(lane)));
        rgb[0][lane] = a.x;
        rgb[1][lane] = a.y;
        rgb[2][lane] = a.z;
      }
      albedo = {hn::Load(d, rgb[0]), hn::Load(d, rgb[1]), hn::Load(d, rgb[2])};
    }
    V tr = hn::Mul(get(paths.tr), albedo.x), tg = hn::Mul(get(paths.tg), albedo.y),
      tb = hn::Mul(get(paths.tb), albedo.z);

    const size_t lights =
        scene.lights ? scene.lights->sampled_count() : scene.sun_count + (scene.environment != nullptr);
    if (lights > 0) {
      V choice = zero;
      if (lights > 1) choice = rng.uniform(everyone);
      const V u1 = rng.uniform(everyone), u2 = rng.uniform(everyone);
      V3 wi{zero, zero, one};
      V lr = zero, lg = zero, lb = zero, pdf_light = zero;
      M chosen_before = hn::FirstN(d, 0), is_delta = chosen_before;
      const SinCosV phi = sincos_2pi(u2);
      for (size_t k = 0; k < scene.sun_count; ++k) {
        const LaneScene::SunLight& sun = scene.suns[k];
        const M mine =
            hn::AndNot(chosen_before, hn::Or(hn::Lt(choice, set(sun.share_end)),
                                             mask_of(k + 1 == scene.sun_count && !scene.environment ? ~0u : 0u)));
        chosen_before = hn::Or(chosen_before, mine);
        const V h = hn::Mul(u1, set(sun.one_minus_cos));
        const V s = hn::Sqrt(hn::Max(hn::Mul(h, hn::Sub(set(2.0f), h)), zero));
        const V a = hn::Mul(s, phi.cos), b = hn::Mul(s, phi.sin), c = hn::Sub(one, h);
        const auto axis = [&](int x) {
          return hn::Add(hn::Add(hn::Mul(a, set(sun.x[x])), hn::Mul(b, set(sun.y[x]))), hn::Mul(c, set(sun.z[x])));
        };
        wi = {hn::IfThenElse(mine, axis(0), wi.x), hn::IfThenElse(mine, axis(1), wi.y),
              hn::IfThenElse(mine, axis(2), wi.z)};
        lr = hn::IfThenElse(mine, set(sun.radiance[0]), lr);
        lg = hn::IfThenElse(mine, set(sun.radiance[1]), lg);
        lb = hn::IfThenElse(mine, set(sun.radiance[2]), lb);
        pdf_light = hn::IfThenElse(mine, set(sun.pdf * sun.share), pdf_light);
        if (sun.delta) is_delta = hn::Or(is_delta, mine);
      }
      if (scene.environment || scene.lights) {
        HWY_ALIGN float f[9][hn::MaxLanes(d)], c[hn::MaxLanes(d)];
        hn::Store(choice, d, c);
        uint32_t delta = 0;
        hn::Store(u1, d, f[0]);
        hn::Store(u2, d, f[1]);
        hn::Store(wi.x, d, f[2]);
        hn::Store(wi.y, d, f[3]);
        hn::Store(wi.z, d, f[4]);
        hn::Store(lr, d, f[5]);
        hn::Store(lg, d, f[6]);
        hn::Store(lb, d, f[7]);
        hn::Store(pdf_light, d, f[8]);
        for (uint32_t left = valid_bits & ~bits_of(chosen_before); left; left &= left - 1) {
          const auto lane = static_cast<size_t>(std::countr_zero(left));
          const dvec2 u(f[0][lane], f[1][lane]);
          LightSample sample;
          if (scene.lights) {
            const dvec3 p = position(lane);
            sample = scene.lights->sample_visible(p, static_cast<double>(c[lane]), u);
            sample.radiance *= far_share(scene.near_lights, sample.light, p);
            paths.shadow_reach[static_cast<size_t>(slots.slot[i + lane])] =
                static_cast<float>(std::min(sample.distance / scene.unit, 1e30));
            delta |= static_cast<uint32_t>(sample.delta) << lane;
          } else {
            sample = scene.environment->sample(u);
            sample.pdf *= static_cast<double>(scene.environment_share);
          }
          f[2][lane] = static_cast<float>(sample.wi.x);
          f[3][lane] = static_cast<float>(sample.wi.y);
          f[4][lane] = static_cast<float>(sample.wi.z);
          f[5][lane] = static_cast<float>(sample.radiance.x);
          f[6][lane] = static_cast<float>(sample.radiance.y);
          f[7][lane] = static_cast<float>(sample.radiance.z);
          f[8][lane] = static_cast<float>(sample.pdf);
        }
        is_delta = hn::Or(is_delta, mask_of(delta));
        wi = {hn::Load(d, f[2]), hn::Load(d, f[3]), hn::Load(d, f[4])};
        lr = hn::Load(d, f[5]);
        lg = hn::Load(d, f[6]);
        lb = hn::Load(d, f[7]);
        pdf_light = hn::Load(d, f[8]);
      }
      const V phase = phase_towards(wi);
      const V mis = hn::IfThenElse(is_delta, one, hn::Div(pdf_light, hn::Add(pdf_light, phase)));
      const V factor = hn::IfThenElseZero(hn::Gt(pdf_light, zero), hn::Div(hn::Mul(phase, mis), pdf_light));
      const V cr = hn::Mul(hn::Mul(tr, lr), factor), cg = hn::Mul(hn::Mul(tg, lg), factor);
      const V cb = hn::Mul(hn::Mul(tb, lb), factor);
      put(cr, paths.cr);
      put(cg, paths.cg);
      put(cb, paths.cb);
      const V3 local = transform(scene.local_from_world, wi);
      put(local.x, paths.sx);
      put(local.y, paths.sy);
      put(local.z, paths.sz);
      put(one, paths.transmittance);
      if (scene.world) put(mis, paths.mis);
      uint32_t worth = valid_bits & bits_of(hn::Gt(hn::Max(hn::Max(cr, cg), cb), zero));
      for (; worth; worth &= worth - 1) shadows.push(slots.slot[i + static_cast<size_t>(std::countr_zero(worth))]);
    }

    const VU events = hn::Add(get_u(paths.events), hn::Set(du, 1));
    put_u(events, paths.events);
    // Russian roulette, as survival() has it.
    const auto late = hn::RebindMask(d, hn::Gt(hn::BitCast(di, events), hn::Set(di, scene.roulette_start - 1)));
    const V largest = hn::Max(hn::Max(tr, tg), tb),
            survival = hn::Min(hn::Max(largest, set(static_cast<float>(kLeastSurvival))), one);
    const M plays = hn::And(everyone, hn::And(late, hn::Lt(survival, one)));
    M lives = everyone;
    if (!hn::AllFalse(d, plays)) {
      const V u = rng.uniform(plays);
      lives = hn::AndNot(hn::And(plays, hn::Ge(u, survival)), everyone);
      const V boost = hn::IfThenElse(plays, hn::Div(one, survival), one);
      tr = hn::Mul(tr, boost);
      tg = hn::Mul(tg, boost);
      tb = hn::Mul(tb, boost);
    }
    const auto cut =
        hn::And(lives, hn::RebindMask(d, hn::Gt(hn::BitCast(di, events), hn::Set(di, scene.max_events - 1))));
    if (!hn::AllFalse(d, cut)) {
      HWY_ALIGN float carried[hn::MaxLanes(d)];
      hn::Store(hn::Max(hn::Max(tr, tg), tb), d, carried);
      for (uint32_t left = bits_of(cut); left; left &= left - 1) {
        ++capped_paths;
        capped_throughput += static_cast<double>(carried[std::countr_zero(left)]);
      }
      lives = hn::AndNot(cut, lives);
    }

    const V xi = rng.uniform(everyone);
    const V one_minus = scene.phase
                            ? each_lane(xi, valid, [&](double x) { return 1.0 - scene.phase->sample_cosine(x); })
                            : phase_sample(g, xi);
    const V sin_theta = hn::Sqrt(hn::Max(hn::Mul(one_minus, hn::Sub(set(2.0f), one_minus)), zero));
    const SinCosV phi = sincos_2pi(rng.uniform(everyone));
    const V3 turned = around(peak, hn::Mul(sin_theta, phi.cos), hn::Mul(sin_theta, phi.sin), hn::Sub(one, one_minus));
    put(phase_towards(turned), paths.pdf);
    put(turned.x, paths.dx);
    put(turned.y, paths.dy);
    put(turned.z, paths.dz);
    const V3 local = transform(scene.local_from_world, turned);
    put(local.x, paths.lx);
    put(local.y, paths.ly);
    put(local.z, paths.lz);
    put(tr, paths.tr);
    put(tg, paths.tg);
    put(tb, paths.tb);
    put_u(rng.s0, paths.s0);
    put_u(rng.s1, paths.s1);
    put_u(rng.s2, paths.s2);
    put_u(rng.s3, paths.s3);
    for (uint32_t left = valid_bits & bits_of(lives); left; left &= left - 1)
      alive.push(slots.slot[i + static_cast<size_t>(std::countr_zero(left))]);
  }
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
