#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/lanes/flights.cpp"
#include "render/lanes/flights.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <numbers>

#include "volume/lane_grid.h"
#include "volume/tracking.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/lanes/cell_walk.h"

enum class Walk { kFlight, kFirst, kShadow };

/// Takes the rays of a list through the majorant cells, up to a light at `reach` where kReach. Free flights end at a
/// real collision, whose position becomes the path's, or leave the grid; forced flights cross the whole grid
/// (lanes_fly_first); shadow rays estimate their transmittance by ratio tracking. Where kColour, the hero channel
/// decides for all, and each channel's share of what happened is accounted for (docs/methods.md, Spectral tracking).
/// kMoved: the density is displaced.
template <Walk kWalk, bool kReach, bool kColour = false, bool kMoved = false>
void track(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList* hits, SlotList* escapes,
           uint64_t& lookups) {
  constexpr bool kShadow = kWalk == Walk::kShadow, kFirst = kWalk == Walk::kFirst;
  const D d;
  const DI di;
  constexpr size_t kMost = RayQueue::kMost;

  RayQueue queue(rays);
  CellWalk walk(scene);
  GeneratorBuffer generators;
  HWY_ALIGN float result[kMost] = {}, carried[kMost] = {}, x[kMost], y[kMost], z[kMost];

  const V zero = hn::Zero(d), one = set(1.0f);
  V tau = zero, weight = one, reach = zero;
  V scattered = zero, lost = zero;  // of a forced flight: the share scattered so far, and its rounding error (Kahan)
  V3 hit_at{zero, zero, zero};
  Generator rng = generators.load();
  uint32_t collided = 0;
  [[maybe_unused]] V hero = one;                            // extinction of the hero channel, relative to the largest
  [[maybe_unused]] V3 colour{one, one, one};                // of the choices' probability, or of the transmittance
  [[maybe_unused]] HWY_ALIGN float channel[4][kMost] = {};  // in memory: colour and hero

  [[maybe_unused]] V time = zero;
  [[maybe_unused]] HWY_ALIGN float frames[kMost] = {};

  const auto finish = [&]() BRUME_INLINE_LAMBDA {
    if (kFirst) {
      // The scattered share becomes the path's throughput; below a hundredth it plays Russian roulette.
      const V u = rng.uniform(mask_of(queue.finished));
      collided = bits_of(hn::Lt(hn::Mul(u, set(0.01f)), scattered));
      hn::Store(hn::Max(scattered, set(0.01f)), d, carried);
    }
    generators.store(rng);
    hn::Store(kWalk == Walk::kFlight ? walk.t : weight, d, result);
    if constexpr (kColour) {
      hn::Store(colour.x, d, channel[0]);
      hn::Store(colour.y, d, channel[1]);
      hn::Store(colour.z, d, channel[2]);
    }
    if (!kShadow) {
      hn::Store(hit_at.x, d, x);
      hn::Store(hit_at.y, d, y);
      hn::Store(hit_at.z, d, z);
    }
    queue.collect([&](size_t lane, size_t s) {
      generators.give_back(paths, s, lane);
      if (kColour) {
        (kShadow ? paths.shadow_r : paths.fr)[s] = channel[0][lane];
        (kShadow ? paths.shadow_g : paths.fg)[s] = channel[1][lane];
        (kShadow ? paths.shadow_b : paths.fb)[s] = channel[2][lane];
      }
      if (kFirst) {
        paths.passed[s] = result[lane];
        paths.tr[s] = paths.tg[s] = paths.tb[s] = carried[lane];
      }
      if (kShadow) {
        paths.transmittance[s] = result[lane];
      } else if (collided >> lane & 1) {
        paths.ox[s] = x[lane];
        paths.oy[s] = y[lane];
        paths.oz[s] = z[lane];
        if (kWalk == Walk::kFlight && kReach) paths.reach[s] = result[lane];
        hits->push(static_cast<int32_t>(s));
      } else {
        escapes->push(static_cast<int32_t>(s));
      }
    });
  };
  const auto load = [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA {
    generators.store(rng);
    const M fresh = mask_of(queue.load([&](size_t lane, size_t s) {
      buffer.ox[lane] = paths.ox[s];
      buffer.oy[lane] = paths.oy[s];
      buffer.oz[lane] = paths.oz[s];
      buffer.dx[lane] = (kShadow ? paths.sx : paths.lx)[s];
      buffer.dy[lane] = (kShadow ? paths.sy : paths.ly)[s];
      buffer.dz[lane] = (kShadow ? paths.sz : paths.lz)[s];
      generators.fetch(paths, s, lane);
      if (kReach) result[lane] = (kShadow ? paths.shadow_reach : paths.reach)[s];
      if (kShadow) carried[lane] = paths.transmittance[s];
      if (kMoved) frames[lane] = scene.open + (scene.close - scene.open) * paths.time[s];
      if (kColour && kShadow) {
        channel[0][lane] = paths.shadow_r[s];
        channel[1][lane] = paths.shadow_g[s];
        channel[2][lane] = paths.shadow_b[s];
      } else if (kColour) {
        channel[3][lane] = scene.extinction_ratio[paths.hero[s]];
      }
    }));
    walk.load(buffer, fresh);
    rng = generators.load();
    weight = hn::IfThenElse(fresh, kShadow ? hn::Load(d, carried) : one, weight);
    if (kMoved) time = hn::Load(d, frames);
    if constexpr (kColour) {
      const auto start = [&](size_t c, V before) {
        return hn::IfThenElse(fresh, kShadow ? hn::Load(d, channel[c]) : one, before);
      };
      colour = {start(0, colour.x), start(1, colour.y), start(2, colour.z)};
      hero = hn::Load(d, channel[3]);
    }
    if (kFirst) {
      scattered = hn::IfThenElse(fresh, zero, scattered);
      lost = hn::IfThenElse(fresh, zero, lost);
    }
    tau = hn::IfThenElse(fresh, rng.exponential(fresh), tau);
    if (kReach) reach = hn::IfThenElse(fresh, hn::Load(d, result), reach);
  };
  drive(queue, walk, scene.stop, finish, load, [&](M active) BRUME_INLINE_LAMBDA {
    // The cell: its majorant, or, where it is empty, an OctantSkip.
    const VI cell_index = walk.index(active);
    const V bound = hn::GatherIndex(d, scene.majorant, cell_index);
    const M empty = hn::Lt(bound, zero);
    const CellWalk::Crossing crossing = walk.ahead(hn::BitCast(di, bound), empty);
    const V sigma_maj = hn::Mul(bound, set(kFirst ? scene.first_sigma : scene.sigma));
    const V until = kReach ? hn::Min(crossing.until, reach) : crossing.until;
    const V remaining = hn::IfThenElse(empty, zero, hn::Mul(hn::Sub(until, walk.t), sigma_maj));
    const M passes = hn::And(active, hn::Or(empty, hn::Ge(tau, remaining)));
    const M collides = hn::AndNot(passes, active);
    tau = hn::IfThenElse(passes, hn::Sub(tau, remaining), tau);
    M done = walk.cross(crossing, passes);
    if (kReach) done = hn::Or(done, hn::And(passes, hn::Ge(crossing.until, reach)));

    // Lanes with a tentative collision: one density look-up.
    if (!hn::AllFalse(d, collides)) {
      walk.t = hn::IfThenElse(collides, hn::Add(walk.t, hn::Div(tau, sigma_maj)), walk.t);
      const V3 p = walk.at(walk.t);
      V value = zero;
      if constexpr (kMoved) {
        value = hn::IfThenElseZero(collides, displaced_density(scene, p, time));
      } else {
        const VI brick = brick_of(scene, cell_index, collides);
        value = scene.interpolate ? hn::IfThenElseZero(collides, interpolated(scene, brick, walk.within(p)))
                                  : one_voxel(walk, rng, p, brick, collides);
      }
      lookups += hn::CountTrue(d, collides);
      // 24 random bits are enough for roulette only: a collision may be less likely than 2^-24.
      const V u = kShadow ? rng.uniform(collides) : rng.fine_uniform(collides);
      if (kFirst) {
        // Each tentative collision scatters its share sigma_t / sigma_maj of the remaining weight. One of them, drawn
        // by reservoir sampling in proportion to what it scattered, becomes the path's vertex. Once less than half is
        // left, a collision is real or null by chance, as in delta tracking.
        const V share = hn::Div(hn::Mul(value, set(scene.sigma)), sigma_maj);
        const M whole = hn::And(collides, hn::Lt(weight, set(0.5f))), decided = hn::And(whole, hn::Lt(u, share));
        const V part = hn::IfThenElse(whole, hn::IfThenElseZero(decided, weight), hn::Mul(weight, share));
        // Summed with compensation (Kahan): shares may be far below the rounding of what is left.
        const V more = hn::Sub(part, lost), sum = hn::Add(scattered, more);
        const M taken = hn::And(collides, hn::Lt(hn::Mul(rng.fine_uniform(collides), sum), part));
        hit_at = {hn::IfThenElse(taken, p.x, hit_at.x), hn::IfThenElse(taken, p.y, hit_at.y),
                  hn::IfThenElse(taken, p.z, hit_at.z)};
        lost = hn::IfThenElse(collides, hn::Sub(hn::Sub(sum, scattered), more), lost);
        scattered = hn::IfThenElse(collides, hn::IfThenElse(decided, one, sum), scattered);
        weight = hn::Sub(one, scattered);
        done = hn::Or(done, decided);
      } else if constexpr (kColour) {
        const V share = hn::Min(hn::Div(value, bound), one);
        const auto real = [&](int c) { return hn::Mul(share, set(scene.extinction_ratio[c])); };
        M hit = hn::FirstN(d, 0);
        if (!kShadow) {
          hit = hn::And(collides, hn::Lt(u, hn::Mul(share, hero)));
          done = hn::Or(done, hit);
          collided |= bits_of(hit);
        }
        const auto times = [&](V before, int c) {
          return hn::IfThenElse(collides, hn::Mul(before, hn::IfThenElse(hit, real(c), hn::Sub(one, real(c)))), before);
        };
        colour = {times(colour.x, 0), times(colour.y, 1), times(colour.z, 2)};
        if (kShadow) {
          const V largest = hn::Max(hn::Max(colour.x, colour.y), colour.z);
          const V surviving = set(static_cast<float>(kSurvivingTransmittance));
          const M small = hn::And(collides, hn::Lt(largest, set(static_cast<float>(kLeastTransmittance))));
          const M survives = hn::Lt(hn::Mul(u, surviving), largest);
          const V factor = hn::IfThenElseZero(survives, hn::Div(surviving, largest));
          const auto rescaled = [&](V v) { return hn::IfThenElse(small, hn::Mul(v, factor), v); };
          colour = {rescaled(colour.x), rescaled(colour.y), rescaled(colour.z)};
          done = hn::Or(done, hn::AndNot(survives, small));
        }
      } else if (kShadow) {
        weight = hn::IfThenElse(collides, hn::Sub(weight, hn::Mul(weight, hn::Div(value, bound))), weight);
        const V surviving = set(static_cast<float>(kSurvivingTransmittance));
        const M small = hn::And(collides, hn::Lt(weight, set(static_cast<float>(kLeastTransmittance))));
        const M survives = hn::Lt(hn::Mul(u, surviving), weight);
        weight = hn::IfThenElse(small, hn::IfThenElseZero(survives, surviving), weight);
        done = hn::Or(done, hn::AndNot(survives, small));
      } else {
        const M hit = hn::And(collides, hn::Lt(hn::Mul(u, bound), value));
        hit_at = {hn::IfThenElse(hit, p.x, hit_at.x), hn::IfThenElse(hit, p.y, hit_at.y),
                  hn::IfThenElse(hit, p.z, hit_at.z)};
        done = hn::Or(done, hit);
        collided |= bits_of(hit);
      }
      tau = hn::IfThenElse(collides, rng.exponential(collides), tau);
    }
    if (!kShadow && !kFirst) collided &= ~(bits_of(done) & ~bits_of(hn::And(done, collides)));
    queue.end(done);
  });
}

void Flight(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
            uint64_t& lookups) {
  const auto flight = scene.displaced     ? scene.chromatic ? track<Walk::kFlight, true, true, true>
                                                            : track<Walk::kFlight, true, false, true>
                          : scene.chromatic ? track<Walk::kFlight, true, true>
                      : scene.flights_end ? track<Walk::kFlight, true>
                                          : track<Walk::kFlight, false>;
  flight(scene, paths, rays, &hits, &escapes, lookups);
}

void First(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
           uint64_t& lookups) {
  (scene.flights_end ? track<Walk::kFirst, true> : track<Walk::kFirst, false>)(scene, paths, rays, &hits, &escapes,
                                                                               lookups);
}

void Shadow(const LaneScene& scene, PathStates& paths, const SlotList& rays, uint64_t& lookups) {
  const auto shadow = scene.displaced     ? scene.chromatic ? track<Walk::kShadow, true, true, true>
                                                            : track<Walk::kShadow, true, false, true>
                          : scene.chromatic ? track<Walk::kShadow, true, true>
                      : scene.shadows_end ? track<Walk::kShadow, true>
                                          : track<Walk::kShadow, false>;
  shadow(scene, paths, rays, nullptr, nullptr, lookups);
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(Flight);
HWY_EXPORT(First);
HWY_EXPORT(Shadow);

void lanes_fly(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
               uint64_t& lookups) {
  HWY_DYNAMIC_DISPATCH(Flight)(scene, paths, rays, hits, escapes, lookups);
}

void lanes_fly_first(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
                     uint64_t& lookups) {
  HWY_DYNAMIC_DISPATCH(First)(scene, paths, rays, hits, escapes, lookups);
}

void lanes_shadow(const LaneScene& scene, PathStates& paths, const SlotList& rays, uint64_t& lookups) {
  HWY_DYNAMIC_DISPATCH(Shadow)(scene, paths, rays, lookups);
}

}  // namespace brume
#endif
