#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/transport/flights.cpp"
#include "render/transport/flights.h"

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

#include "render/transport/cell_walk.h"
#include "render/transport/detail_noise.h"

enum class Walk { kFlight, kFirst, kShadow };
/// What the density is: the interpolated values, the same with detail, or displaced, with or without detail.
enum class Field { kStored, kDetailed, kMoved };

/// Takes the rays of a list through the majorant cells, up to an end at `t_max` where kEnds. Free flights end at a
/// real collision, whose position becomes the path's, or leave the grid; forced flights cross the whole grid
/// (lanes_fly_first); shadow rays estimate their transmittance by ratio tracking. Where kColour, the hero channel
/// decides for all, and each channel's share of what happened is accounted for (docs/methods.md, Spectral tracking).
template <Walk kWalk, bool kEnds, bool kColour, Field kField>
class Tracker {
 public:
  HWY_INLINE Tracker(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList* hits, SlotList* escapes,
                     uint64_t& lookups)
      : scene_(scene),
        paths_(paths),
        hits_(hits),
        escapes_(escapes),
        lookups_(lookups),
        queue_(rays),
        walk_(cells_of(scene)),
        rng_(generators_.load()) {}

  HWY_INLINE void run() {
    drive(
        queue_, walk_, scene_.stop, [&]() BRUME_INLINE_LAMBDA { finish(); },
        [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA { load(buffer); },
        [&](M active) BRUME_INLINE_LAMBDA { step(active); });
  }

 private:
  static constexpr bool kShadow = kWalk == Walk::kShadow, kFirst = kWalk == Walk::kFirst;
  static constexpr bool kMoved = kField == Field::kMoved;
  static constexpr size_t kMost = RayQueue::kMost;

  static const LaneCells& cells_of(const LaneScene& scene) {
    return kField == Field::kDetailed ? scene.detail.cells : scene;
  }

  HWY_INLINE void finish() {
    const D d;
    if (kFirst) {
      // The scattered share becomes the path's throughput; below a hundredth it plays Russian roulette.
      const V u = rng_.uniform(mask_of(queue_.finished));
      collided_ = bits_of(u * 0.01f < scattered_);
      hn::Store(hn::Max(scattered_, set(0.01f)), d, carried_);
    }
    generators_.store(rng_);
    hn::Store(kWalk == Walk::kFlight ? walk_.t : weight_, d, result_);
    if constexpr (kColour) channels_.store(colour_);
    if (!kShadow) collision_.store(hit_at_);
    queue_.collect([&](size_t lane, size_t s) {
      generators_.give_back(paths_, s, lane);
      if (kColour) (kShadow ? paths_.shadow_colour : paths_.flight_factor).set(s, channels_[lane]);
      if (kFirst) {
        paths_.camera_transmittance[s] = result_[lane];
        paths_.throughput.set(s, vec3(carried_[lane]));
      }
      if (kShadow) {
        paths_.transmittance[s] = result_[lane];
      } else if (collided_ >> lane & 1) {
        paths_.flight.o.set(s, collision_[lane]);
        if (kWalk == Walk::kFlight && kEnds) paths_.travel[s] = result_[lane];
        hits_->push(s);
      } else {
        escapes_->push(s);
      }
    });
  }

  HWY_INLINE void load(CellWalk::Buffer& buffer) {
    const D d;
    const V zero = hn::Zero(d), one = set(1.0f);
    const LocalRays& rays = kShadow ? paths_.shadow : paths_.flight;
    const Column3& origins = kShadow && scene_.keeps_local ? paths_.flight.o : rays.o;
    generators_.store(rng_);
    const M fresh = mask_of(queue_.load([&](size_t lane, size_t s) {
      buffer.fetch(origins, rays.d, s, lane);
      generators_.fetch(paths_, s, lane);
      if (kEnds) result_[lane] = rays.end[s];
      if (kShadow) carried_[lane] = paths_.transmittance[s];
      if (kMoved) frames_[lane] = frame_of(scene_, paths_, s);
      if (kColour && kShadow) channels_.set(lane, paths_.shadow_colour[s]);
      if (kColour && !kShadow) heroes_[lane] = scene_.extinction_ratio[paths_.hero[s]];
    }));
    walk_.load(buffer, fresh);
    rng_ = generators_.load();
    weight_ = hn::IfThenElse(fresh, kShadow ? hn::Load(d, carried_) : one, weight_);
    if (kMoved) time_ = hn::Load(d, frames_);
    if constexpr (kColour) {
      colour_ = select(fresh, kShadow ? channels_.load() : V3{one, one, one}, colour_);
      hero_ = hn::Load(d, heroes_);
    }
    if (kFirst) {
      scattered_ = hn::IfThenElse(fresh, zero, scattered_);
      lost_ = hn::IfThenElse(fresh, zero, lost_);
    }
    tau_ = hn::IfThenElse(fresh, rng_.exponential(fresh), tau_);
    if (kEnds) t_max_ = hn::IfThenElse(fresh, hn::Load(d, result_), t_max_);
  }

  HWY_INLINE void step(M active) {
    const D d;
    const V zero = hn::Zero(d);
    // The cell: its majorant, or, where it is empty, an OctantSkip.
    const VI cell_index = walk_.index(active);
    const V bound = hn::GatherIndex(d, walk_.grid.majorant, cell_index);
    const M empty = bound < zero;
    const CellWalk::Crossing crossing = walk_.ahead(hn::BitCast(DI(), bound), empty);
    const V sigma_maj = bound * (kFirst ? scene_.first_sigma : scene_.sigma);
    const V until = kEnds ? hn::Min(crossing.until, t_max_) : crossing.until;
    const V remaining = hn::IfThenElse(empty, zero, (until - walk_.t) * sigma_maj);
    const M passes = hn::And(active, hn::Or(empty, tau_ >= remaining));
    const M collides = hn::AndNot(passes, active);
    tau_ = hn::IfThenElse(passes, tau_ - remaining, tau_);
    M done = walk_.cross(crossing, passes);
    if (kEnds) done = hn::Or(done, hn::And(passes, crossing.until >= t_max_));
    if (!hn::AllFalse(d, collides)) {
      walk_.t = hn::IfThenElse(collides, walk_.t + tau_ / sigma_maj, walk_.t);
      done = hn::Or(done, collide(cell_index, bound, sigma_maj, collides));
      tau_ = hn::IfThenElse(collides, rng_.exponential(collides), tau_);
    }
    if (!kShadow && !kFirst) collided_ &= ~(bits_of(done) & ~bits_of(hn::And(done, collides)));
    queue_.end(done);
  }

  /// Tentative collisions: one density look-up each. Returns whose rays end there.
  HWY_INLINE M collide(VI cell_index, V bound, V sigma_maj, M collides) {
    const D d;
    const V3 p = walk_.at(walk_.t);
    V value = hn::Zero(d);
    if constexpr (kMoved) {
      const V3 stored = stored_at(scene_, p, time_);
      value = hn::IfThenElseZero(collides, density_at(scene_.density, stored));
      if (scene_.detail.octaves > 0) value = with_detail(scene_.detail, stored, value, rng_, collides);
    } else {
      const VI brick = brick_of(walk_.grid, cell_index, collides);
      value = scene_.interpolate ? hn::IfThenElseZero(collides, interpolated(walk_.grid, brick, walk_.within(p)))
                                 : one_voxel(walk_, rng_, p, brick, collides);
    }
    lookups_ += hn::CountTrue(d, collides);
    // 24 random bits are enough for roulette only: a collision may be less likely than 2^-24.
    const V u = kShadow ? rng_.uniform(collides) : rng_.fine_uniform(collides);
    if constexpr (kField == Field::kDetailed) {
      // Where no detail could make a real collision of it, none is looked up.
      const M matters =
          kWalk == Walk::kFlight && !kColour ? hn::And(collides, u * bound < value * scene_.detail.greatest) : collides;
      value = with_detail(scene_.detail, p, value, rng_, matters);
    }
    if constexpr (kFirst) {
      return scatter_share(p, value * scene_.sigma / sigma_maj, u, collides);
    } else if constexpr (kColour) {
      return collide_by_channel(hn::Min(value / bound, set(1.0f)), u, collides);
    } else if constexpr (kShadow) {
      weight_ = hn::IfThenElse(collides, weight_ - weight_ * (value / bound), weight_);
      const auto [small, survives] = roulette(weight_, u, collides);
      weight_ = hn::IfThenElse(small, hn::IfThenElseZero(survives, surviving()), weight_);
      return hn::AndNot(survives, small);
    } else {
      const M hit = hn::And(collides, u * bound < value);
      hit_at_ = select(hit, p, hit_at_);
      collided_ |= bits_of(hit);
      return hit;
    }
  }

  /// Each tentative collision scatters its share sigma_t / sigma_maj of the remaining weight. One of them, drawn by
  /// reservoir sampling in proportion to what it scattered, becomes the path's vertex. Once less than half is left, a
  /// collision is real or null by chance, as in delta tracking.
  HWY_INLINE M scatter_share(const V3& p, V share, V u, M collides) {
    const V one = set(1.0f);
    const M whole = hn::And(collides, weight_ < 0.5f), decided = hn::And(whole, u < share);
    const V part = hn::IfThenElse(whole, hn::IfThenElseZero(decided, weight_), weight_ * share);
    // Summed with compensation (Kahan): shares may be far below the rounding of what is left.
    const V more = part - lost_, sum = scattered_ + more;
    const M taken = hn::And(collides, rng_.fine_uniform(collides) * sum < part);
    hit_at_ = select(taken, p, hit_at_);
    lost_ = hn::IfThenElse(collides, sum - scattered_ - more, lost_);
    scattered_ = hn::IfThenElse(collides, hn::IfThenElse(decided, one, sum), scattered_);
    weight_ = one - scattered_;
    return decided;
  }

  /// @param share  of the largest channel: its extinction to the majorant
  HWY_INLINE M collide_by_channel(V share, V u, M collides) {
    const V one = set(1.0f);
    const V3 real = set3(scene_.extinction_ratio) * share;
    M hit = hn::FirstN(D(), 0);
    if (!kShadow) {
      hit = hn::And(collides, u < share * hero_);
      collided_ |= bits_of(hit);
    }
    const V3 after = colour_ * select(hit, real, V3{one, one, one} - real);
    colour_ = select(collides, after, colour_);
    if (!kShadow) return hit;
    const V largest = max_component(colour_);
    const auto [small, survives] = roulette(largest, u, collides);
    colour_ = select(small, colour_ * hn::IfThenElseZero(survives, surviving() / largest), colour_);
    return hn::AndNot(survives, small);
  }

  static HWY_INLINE V surviving() { return set(static_cast<float>(kSurvivingTransmittance)); }
  struct Roulette {
    M plays, survives;
  };
  /// Of shadow rays with little weight left.
  static HWY_INLINE Roulette roulette(V weight, V u, M collides) {
    return {hn::And(collides, weight < static_cast<float>(kLeastTransmittance)), u * surviving() < weight};
  }

  const LaneScene& scene_;
  PathStates& paths_;
  SlotList *hits_, *escapes_;
  uint64_t& lookups_;
  RayQueue queue_;
  CellWalk walk_;
  GeneratorBuffer generators_;
  Generator rng_;
  HWY_ALIGN float result_[kMost] = {}, carried_[kMost] = {}, frames_[kMost] = {}, heroes_[kMost] = {};
  Lanes3 channels_, collision_;
  V tau_ = hn::Zero(D()), weight_ = set(1.0f), t_max_ = hn::Zero(D()), time_ = hn::Zero(D());
  V scattered_ = hn::Zero(D()),
    lost_ = hn::Zero(D());  // of a forced flight: share scattered so far; rounding error of that sum
  V3 hit_at_ = zero3();
  V hero_ = set(1.0f);                          // extinction of the hero channel, relative to the largest
  V3 colour_{set(1.0f), set(1.0f), set(1.0f)};  // of the choices' probability, or of the transmittance
  uint32_t collided_ = 0;
};

using Track = void (*)(const LaneScene&, PathStates&, const SlotList&, SlotList*, SlotList*, uint64_t&);
template <Walk kWalk, bool kEnds, bool kColour, Field kField>
void track(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList* hits, SlotList* escapes,
           uint64_t& lookups) {
  Tracker<kWalk, kEnds, kColour, kField>(scene, paths, rays, hits, escapes, lookups).run();
}

/// Rays through what moves have ends, as those through what is chromatic.
template <Walk kWalk>
Track tracker(const LaneScene& scene, bool ends) {
  if (scene.displaced)
    return scene.chromatic ? track<kWalk, true, true, Field::kMoved> : track<kWalk, true, false, Field::kMoved>;
  if (scene.detail.octaves > 0)
    return scene.chromatic ? track<kWalk, true, true, Field::kDetailed>
           : ends          ? track<kWalk, true, false, Field::kDetailed>
                           : track<kWalk, false, false, Field::kDetailed>;
  return scene.chromatic ? track<kWalk, true, true, Field::kStored>
         : ends          ? track<kWalk, true, false, Field::kStored>
                         : track<kWalk, false, false, Field::kStored>;
}

void Flight(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
            uint64_t& lookups) {
  tracker<Walk::kFlight>(scene, scene.flights_end)(scene, paths, rays, &hits, &escapes, lookups);
}

/// Of one grey grid that stands still.
template <Field kField>
Track first_tracker(const LaneScene& scene) {
  return scene.flights_end ? track<Walk::kFirst, true, false, kField> : track<Walk::kFirst, false, false, kField>;
}

void First(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
           uint64_t& lookups) {
  (scene.detail.octaves > 0 ? first_tracker<Field::kDetailed>(scene) : first_tracker<Field::kStored>(scene))(
      scene, paths, rays, &hits, &escapes, lookups);
}

void Shadow(const LaneScene& scene, PathStates& paths, const SlotList& rays, uint64_t& lookups) {
  tracker<Walk::kShadow>(scene, scene.shadows_end)(scene, paths, rays, nullptr, nullptr, lookups);
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
