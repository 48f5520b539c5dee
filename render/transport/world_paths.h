#pragma once
#include <array>
#include <bit>
#include <cstdint>

#include "base/math.h"
#include "base/rng.h"
#include "render/transport/estimator.h"
#include "render/transport/path_record.h"
#include "render/transport/path_states.h"
#include "render/transport/plan.h"
#include "render/world/lights.h"
#include "render/world/surfaces.h"

namespace brume {

/// Where the paths of a thread are in the world, in double precision.
///
/// Their rays in the local coordinates of a medium exist for one flight through it. Where Plan::one_grid it is the
/// other way round: PathStates::flight stays from event to event, and `ray` is made of it where something asks for it.
struct WorldPaths {
  static constexpr int32_t kNoMedium = -1;

  std::array<Ray, kPool> ray;                   ///< from the last vertex, or the eye, on
  std::array<double, kPool> end;                ///< ray parameter of what ends the flight; infinity where nothing does
  std::array<int32_t, kPool> medium;            ///< that a collision at `end` is with, or kNoMedium
  std::array<int32_t, kPool> instance;          ///< likewise, where that medium has instances: which
  std::array<const FiniteLight*, kPool> light;  ///< at `end`; null for none
  std::array<SurfaceHit, kPool> hit;            ///< at `end`, where on_surface
  std::array<bool, kPool> on_surface;
  /// A medium, and which of its instances.
  struct Place {
    int32_t medium = kNoMedium, instance = 0;
  };
  std::array<Place, kPool> last_collision;  ///< of the path
  std::array<double, kPool> time;           ///< in [0, 1] of the shutter
  std::array<double, kPool> begin;          ///< ray parameter at which the local ray begins

  std::array<Ray, kPool> shadow;  ///< towards the light sample; not where Plan::one_grid
  std::array<double, kPool> shadow_end;

  /// What a path remembers of its vertices.
  struct Past {
    bool specular = false;          ///< the last one was a mirror or clear glass
    bool sampled_light = false;     ///< since one that sampled a light, it has gone at most straight through surfaces
    bool straight = false;          ///< and at least through one
    bool samples_fields = false;    ///< that light may have been a field that emits
    bool on_surface = false;        ///< the last one was on a surface
    bool first_on_surface = false;  ///< the first event was on a surface
    bool in_hole = false;           ///< it ended on a holdout
    bool to_catcher = false;        ///< the light sample is a shadow catcher's
    double passed = 0;              ///< from the last vertex to the light that its ray passed and goes on from
  };
  std::array<Past, kPool> past;
  bool any_surface = false;         ///< in the scene
  std::array<vec3, kPool> surface;  ///< light of surfaces that emit or are lit directly
  /// Light of each light group by itself, for each slot; none where the scene has no groups.
  struct GroupLight {
    vec3 direct{0}, indirect{0};
  };
  size_t groups = 0;
  std::vector<GroupLight> group_light;
  std::array<size_t, kPool> sampled_group;        ///< of the light sample
  std::array<const Light*, kPool> sampled_light;  ///< likewise; null for suns and the environment sampled in lanes
  std::array<PathRecord*, kPool> record;          ///< to be filled; null where none is wanted

  /// A path's ray from its last vertex on, which lies `past.passed` before it.
  Ray from_vertex(size_t slot) const { return {ray[slot].o - past[slot].passed * ray[slot].d, ray[slot].d}; }

  /// What a path remembers of its vertices; where Plan::one_grid they are all alike.
  const Past& past_of(size_t slot, const Plan& plan) const {
    static constexpr Past kNone{}, kSamplesFields{.samples_fields = true};
    if (!plan.one_grid) return past[slot];
    return plan.samples_fields(0) ? kSamplesFields : kNone;
  }

  /// Prepares a path's groups.
  void clear_groups(size_t slot) {
    for (size_t g = 0; g < groups; ++g) group_light[slot * groups + g] = {};
  }
  /// Adds light to a group, where there are any.
  void add_to_group(size_t slot, size_t group, const vec3& L, bool direct) {
    if (groups == 0) return;
    GroupLight& found = group_light[slot * groups + group];
    (direct ? found.direct : found.indirect) += L;
  }

  /// Keeps how far a light sample is, its group and, of the first event, what was drawn.
  void note_light(size_t slot, const LightSample& sample, const dvec2& u, bool first) {
    shadow_end[slot] = sample.distance;
    sampled_light[slot] = sample.light;
    if (sample.light) sampled_group[slot] = sample.light->group;
    if (!record[slot] || !first) return;
    record[slot]->light_1 = static_cast<float>(sample.index);
    record[slot]->light_uv_1 = vec2(u);
  }
};

/// The generator of one path, number by number; the lanes' Generator is the same one.
class PathGenerator {
 public:
  PathGenerator(PathStates& p, size_t slot)
      : s0_(p.generator[0][slot]), s1_(p.generator[1][slot]), s2_(p.generator[2][slot]), s3_(p.generator[3][slot]) {}

  void seed(uint64_t seed) {
    const uint64_t a = mix64(seed), b = mix64(seed ^ 0xda3e39cb94b95bdbull) | 1u;  // never all zero
    s0_ = static_cast<uint32_t>(a);
    s1_ = static_cast<uint32_t>(a >> 32);
    s2_ = static_cast<uint32_t>(b);
    s3_ = static_cast<uint32_t>(b >> 32);
  }
  using State = std::array<uint32_t, 4>;
  State state() const { return {s0_, s1_, s2_, s3_}; }
  void set(const State& s) { s0_ = s[0], s1_ = s[1], s2_ = s[2], s3_ = s[3]; }

  uint32_t bits() {
    const uint32_t result = std::rotl(s0_ + s3_, 7) + s0_, t = s1_ << 9;
    s2_ ^= s0_;
    s3_ ^= s1_;
    s1_ ^= s2_;
    s0_ ^= s3_;
    s2_ ^= t;
    s3_ = std::rotl(s3_, 11);
    return result;
  }
  /// In the open interval (0, 1), 32 bits.
  double uniform() { return (bits() + 0.5) * 0x1p-32; }
  dvec2 pair() {
    const double x = uniform();
    return {x, uniform()};
  }
  double exponential() { return -portable_log(uniform()); }
  /// For a loop of unknown length.
  Rng stream() {
    const uint64_t high = bits();
    return Rng(high << 32 | bits());
  }

 private:
  uint32_t &s0_, &s1_, &s2_, &s3_;
};

/// Adds light found after `events` events to a path's sums. Scattered at most once it is direct (docs/methods.md,
/// Direct and indirect light).
inline void deposit(PathStates& p, WorldPaths& world, size_t i, const vec3& L, uint32_t events) {
  const bool direct = is_direct(events);
  if (direct && world.any_surface && world.past[i].first_on_surface) {
    world.surface[i] += L;
    return;
  }
  Column3& sum = direct ? p.direct : p.indirect;
  sum.set(i, sum[i] + L);
}

/// The same, and to its light group.
inline void deposit(PathStates& p, WorldPaths& world, size_t i, const vec3& L, uint32_t events, size_t group) {
  world.add_to_group(i, group, L, is_direct(events));
  deposit(p, world, i, L, events);
}

}  // namespace brume
