#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/guides/ray_march.cpp"
#include "render/guides/ray_march.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>

#include "render/guides/forward_peak.h"
#include "volume/lane_grid.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/cell_walk.h"
#include "render/transport/detail_noise.h"

// Of the step for each free path behind the eye's first ones.
constexpr float kStepGrowth = 0.25f, kGrowingDepth = 2, kLongestStep = 4;
// A step may be longer by the ray's stride as far as the medium at the last one was thinner than this.
constexpr float kThinStep = 0.03f;
// Steps that share one look-up of suns and lamps: so many at the start of a ray, of no more optical depth than this.
constexpr float kLightSteps = 2, kLightThickness = 0.12f;
// Optical depth of the steps that share one look-up of the fields at nodes.
constexpr float kNodeThickness = 0.5f;
constexpr float kOpaque = 6e-3f;     // transmittance of an eighth of the extinction at which a ray ends
constexpr float kDeepestPeak = 600;  // as ForwardPeak

/// 1 - e^-x for x >= 0, relative error below 3e-7 for small x, too.
HWY_INLINE V one_minus_attenuation(V x) {
  const SplitExponential e(-x);
  return 1.0f - e.power - e.power * e.rest;
}

/// 1 - q^2 of 1 - q.
HWY_INLINE V of_square(V one_minus_q) {
  return one_minus_q * (2.0f - one_minus_q);
}

/// 16-bit numbers of a table and those behind them. @param index  of the first
struct ShortPair {
  V first, second;
};
HWY_INLINE ShortPair short_pair(const uint16_t* table, VI index) {
  const DI di;
  const DU du;
#if HWY_TARGET <= HWY_AVX2
  const VI both = hn::GatherOffset(di, reinterpret_cast<const int32_t*>(table), index + index);
#else
  HWY_ALIGN int32_t at[RayQueue::kMost], word[RayQueue::kMost];
  hn::Store(index, di, at);
  for (size_t lane = 0; lane < hn::Lanes(di); ++lane) std::memcpy(word + lane, table + at[lane], sizeof(int32_t));
  const VI both = hn::Load(di, word);
#endif
  const VU bits = hn::BitCast(du, both);
  const auto number = [](VU v) { return hn::ConvertTo(D(), hn::BitCast(DI(), v)); };
  return {number(hn::And(bits, hn::Set(du, 0xffffu))), number(hn::ShiftRight<16>(bits))};
}

/// A number of each lane, in memory between steps.
struct Lane {
  HWY_ALIGN Lanes lanes = {};

  HWY_INLINE V load() const { return hn::Load(D(), lanes); }
  HWY_INLINE void store(V v) { hn::Store(v, D(), lanes); }
  HWY_INLINE void store(M mask, V v) { store(hn::IfThenElse(mask, v, load())); }
  HWY_INLINE void add(V v) { store(load() + v); }
  float& operator[](size_t lane) { return lanes[lane]; }
  float operator[](size_t lane) const { return lanes[lane]; }
};

/// Of all media at a point of each ray.
struct MediaAt {
  V extinction, albedo, g, density;
  V3 gradient, tint;
  V seen;  // share of the extinction that is of no holdout
};

/// A line in the coordinates of a grid or lattice.
struct Line {
  Lanes3 start, along;

  HWY_INLINE V3 at(V t) const { return start.load() + along.load() * t; }
  void set(size_t lane, const MarchedRay::Place& place) {
    start.set(lane, {place.start[0], place.start[1], place.start[2]});
    along.set(lane, {place.along[0], place.along[1], place.along[2]});
  }
};

/// Part of a ray whose light is looked up at once: weights of what is seen of it, with the extinction, a half, a
/// quarter, an eighth of it, and without the forward peak, also as a share of that extinction; sums over it, weighted
/// by thickness.
struct Segment {
  Lane begin, end, w, w2, w4, w8, scaled, unpeaked, thickness, distance, peaks, albedo, g;  // peaks: peaks_ before it
  Lane tint[3];                                                                             // times albedo

  template <class Visit>
  static HWY_INLINE void each_sum(Visit&& visit) {
    for (Lane Segment::*sum :
         {&Segment::w, &Segment::w2, &Segment::w4, &Segment::w8, &Segment::scaled, &Segment::unpeaked,
          &Segment::thickness, &Segment::distance, &Segment::peaks, &Segment::albedo, &Segment::g})
      visit([sum](auto& of) -> auto& { return of.*sum; });
    for (int c = 0; c < 3; ++c) visit([c](auto& of) -> auto& { return of.tint[c]; });
  }
  /// Begins anew at the end, in the lanes of a mask.
  HWY_INLINE void clear(M mask) {
    begin.store(mask, end.load());
    each_sum([&](auto sum) { sum(*this).store(hn::IfThenZeroElse(mask, sum(*this).load())); });
  }
  void clear_lane(size_t lane) {
    begin[lane] = end[lane] = 0;
    each_sum([&](auto sum) { sum(*this)[lane] = 0; });
  }
  /// Joins the segment that follows, in the lanes of a mask.
  HWY_INLINE void join(const Segment& next, M mask) {
    const M fresh = hn::And(mask, thickness.load() <= 0.0f);
    begin.store(fresh, next.begin.load());
    end.store(mask, next.end.load());
    each_sum([&](auto sum) { sum(*this).add(hn::IfThenElseZero(mask, sum(next).load())); });
  }
};

/// The light of a sun or lamp on its way to the eye, and what is seen of it.
struct TurnedLanes {
  Line place;  // on a sun's lattice
  Lane irradiance, mean_depth, phase[4], peak[8];
  Lane single, forward, octave[3], soft[4];  // as GroupSums
  Lane wide_single, wide_forward;            // of the segments whose fields are not added yet

  void set(size_t lane, const TurnedLight& light) {
    irradiance[lane] = light.irradiance;
    mean_depth[lane] = light.mean_depth;
    for (size_t i = 0; i < 4; ++i) phase[i][lane] = light.phase[i];
    for (size_t i = 0; i < 8; ++i) peak[i][lane] = light.peak[i];
  }
  /// Phases and peaks at a place in each of MarchScene::turns.
  HWY_INLINE void look_up(const float* turns, V turn, M mask) {
    const V first = hn::Min(hn::Floor(turn), hn::Set(D(), static_cast<float>(MarchScene::kTurns - 1)));
    const VI index = hn::ConvertTo(DI(), first);
    const auto next = [&] {
      return between_entries(std::exchange(turns, turns + MarchScene::kTurns + 1), index, turn - first);
    };
    for (Lane& one : phase) one.store(mask, next());
    for (Lane& one : peak) one.store(mask, next());
  }
  void begin(size_t lane, const MarchedRay::Place& at, const TurnedLight& light) {
    place.set(lane, at);
    set(lane, light);
    single[lane] = forward[lane] = wide_single[lane] = wide_forward[lane] = 0;
    for (Lane& sum : octave) sum[lane] = 0;
    for (Lane& sum : soft) sum[lane] = 0;
  }
  void add_to(GroupSums& group, size_t lane) const {
    group.single += single[lane];
    group.forward += forward[lane];
    for (size_t i = 0; i < 3; ++i) group.octave[i] += octave[i][lane];
    for (size_t i = 0; i < 4; ++i) group.soft[i] += soft[i][lane];
  }
};

/// Where a point lies among nodes that are counted along three axes: the first of eight, and how far it is from there
/// to the next ones. Beyond the outermost nodes as on the border.
struct Cell {
  VI node[3];
  V f[3];

  HWY_INLINE Cell(const V3& p, const ivec3& n) {
    const V place[3] = {p.x, p.y, p.z};
    for (int a = 0; a < 3; ++a) {
      const V c = hn::Min(hn::Max(place[a], hn::Zero(D())), set(static_cast<float>(n[a] - 1)));
      const V whole = hn::Min(hn::Floor(c), set(static_cast<float>(n[a] - 2)));
      node[a] = hn::ConvertTo(DI(), whole);
      f[a] = c - whole;
    }
  }
};

/// As many rays as there are lanes, on their way.
class RayMarch {
 public:
  RayMarch(const MarchScene& scene, const MarchedFields& fields, MarchBatch& batch)
      : scene_(scene),
        fields_(fields),
        batch_(batch),
        to_lights_(static_cast<float>(fields.table.lattice.spacing / scene.nodes.spacing)),
        lights_origin_((fields.table.lattice.origin - scene.nodes.origin) / scene.nodes.spacing) {}

  void run() {
    for (size_t lane = 0; lane < hn::Lanes(D()); ++lane) refill(lane);
    while (busy_) step();
  }

 private:
  template <class Visit>
  HWY_INLINE void for_each_lane(M mask, Visit&& visit) const {
    for (uint32_t bits = bits_of(mask); bits; bits &= bits - 1) {
      const auto lane = static_cast<size_t>(std::countr_zero(bits));
      visit(lane, *ray_[lane]);
    }
  }
  /// The same with a number of each lane.
  template <class Visit>
  HWY_INLINE void for_each_lane(M mask, V number, Visit&& visit) const {
    HWY_ALIGN Lanes numbers;
    hn::Store(number, D(), numbers);
    for_each_lane(mask, [&](size_t lane, MarchedRay& ray) { visit(lane, ray, numbers[lane]); });
  }

  /// Gives a lane the next ray, past those that meet nothing.
  void refill(size_t lane) {
    busy_ &= ~(1u << lane);
    while (next_ < batch_.rays.size() && batch_.rays[next_].misses()) ++next_;
    if (next_ == batch_.rays.size()) return;
    MarchedRay& ray = batch_.rays[next_++];
    ray_[lane] = &ray;
    busy_ |= 1u << lane;
    for (size_t i = 0; i < scene_.grids.size(); ++i) grid_[i].set(lane, ray.grid[i]);
    for (size_t i = 0; i < scene_.shapes.size(); ++i) {
      shape_begin_[i][lane] = ray.shape[i].x;
      shape_end_[i][lane] = ray.shape[i].y;
    }
    nodes_.set(lane, ray.nodes);
    for (size_t k = 0; k < scene_.lights.size(); ++k) light_[k].begin(lane, ray.light[k], ray.turned[k]);
    near_ = ray.lamps > 0 ? near_ | 1u << lane : near_ & ~(1u << lane);
    stride_[lane] = ray.stride;
    offset_[lane] = ray.offset;
    for (Lane* one : {&left_, &left2_, &left4_, &left8_, &left_scaled_}) (*one)[lane] = 1;
    for (Lane* sum : {&depth_, &peaks_, &extinction_, &opacity_, &first_, &distance_, &distance2_, &density_})
      (*sum)[lane] = 0;
    gradient_.set(lane, vec3(0));
    segment_.clear_lane(lane);
    wide_.clear_lane(lane);
    part_[lane] = ray.first_part;
    begin_part(lane);
  }

  /// Steps of neighbouring pixels begin at the same distances from the eye, wherever their cells begin.
  void begin_part(size_t lane) {
    const vec2& part = batch_.parts[part_[lane]];
    begin_[lane] = part.x;
    end_[lane] = part.y;
    t_[lane] = (std::floor(part.x / stride_[lane] - offset_[lane]) + offset_[lane]) * stride_[lane];
    segment_end_[lane] = t_[lane];
  }

  void finish(size_t lane) {
    MarchedRay& ray = *ray_[lane];
    ray.transmittance = left_[lane];
    ray.scaled_transmittance = left_scaled_[lane];
    ray.opacity = opacity_[lane];
    ray.first = first_[lane];
    ray.distance = distance_[lane];
    ray.distance2 = distance2_[lane];
    ray.density = density_[lane];
    ray.gradient = gradient_[lane];
    if (ray.opacity > 0)
      for (size_t k = 0; k < scene_.lights.size(); ++k)
        light_[k].add_to(ray.sums->groups[scene_.lights[k].group], lane);
    refill(lane);
  }

  HWY_INLINE void step();
  HWY_INLINE void take(M active, V t, V middle, V length, V next, V thickness, const MediaAt& media);
  HWY_INLINE V step_length(M active, V t) const;
  V step_near_lamps(V t) const;
  HWY_INLINE MediaAt media_at(M active, V t) const;
  HWY_INLINE void add_grid(const MarchedGrid& grid, const V3& p, M active, MediaAt& sum) const;
  HWY_INLINE void add_shape(size_t shape, V t, M active, MediaAt& sum) const;
  MediaAt media_point_by_point(M active, V t) const;
  void add_light(M mask);
  HWY_INLINE void add_turned_light(size_t k, M mask);
  HWY_INLINE V scale_of(V albedo, V g) const;
  HWY_INLINE V sun_depth(const SunDepth& sun, const V3& place, M mask) const;
  HWY_INLINE V3 place_at_nodes(M mask, V t) const;
  HWY_INLINE V at_nodes(const float* values, const Cell& cell, M mask) const;
  void add_fields(M mask);
  /// Of each ray that keeps what is seen of its steps.
  void keep_step(M mask, V t, V next, V w, V left);
  void end_parts(M ended, M opaque);

  const MarchScene& scene_;
  const MarchedFields& fields_;
  MarchBatch& batch_;
  // From places on the lattice of the fields to those on the one of what is known of lights.
  const float to_lights_;
  const vec3 lights_origin_;
  size_t next_ = 0;
  uint32_t busy_ = 0, near_ = 0;  // lanes; those that pass a lamp
  MarchedRay* ray_[hn::MaxLanes(D())] = {};
  uint32_t part_[hn::MaxLanes(D())] = {};
  Line grid_[kMostMarchedGrids], nodes_;
  Lane shape_begin_[kMostMarchedShapes], shape_end_[kMostMarchedShapes];
  TurnedLanes light_[kMostSharpLights];
  Lane stride_, offset_, t_, begin_, end_, segment_end_;
  // Transmittances with the extinction, a half, a quarter, an eighth of it, and without the forward peak.
  Lane left_, left2_, left4_, left8_, left_scaled_;
  Lane depth_, peaks_;  // optical depth so far; and of forward peaks alone
  Lane extinction_;     // at the last step
  Lane opacity_, first_, distance_, distance2_, density_;
  Lanes3 gradient_;
  Segment segment_, wide_;  // whose light of suns and lamps, and of fields at nodes, is not added yet
};

HWY_INLINE V RayMarch::step_length(M active, V t) const {
  const V stride = stride_.load();
  V length = hn::IfThenElse(extinction_.load() * stride < kThinStep, stride, set(1.0f));
  const V deeper = hn::Max(depth_.load() - kGrowingDepth, hn::Zero(D()));
  length = length * hn::Min(set(kLongestStep), 1.0f + kStepGrowth * deeper);
  if (!(scene_.steps.even_stride > 1)) return length;
  Lane steps;
  for_each_lane(active, t, [&](size_t lane, MarchedRay& ray, float from) {
    steps[lane] = scene_.even_steps(ray, from, end_[lane]);
  });
  return hn::Max(length, stride * steps.load());
}

/// As MarchScene has it, of the rays that pass a lamp; else 1.
V RayMarch::step_near_lamps(V t) const {
  Lane longest;
  longest.store(set(1.0f));
  for_each_lane(mask_of(near_ & busy_), t, [&](size_t lane, MarchedRay& ray, float from) {
    longest[lane] = MarchScene::step_near_lamps(ray, from);
  });
  return longest.load();
}

/// Adds what a grid has at a point to what all media have; albedo and the like times extinction.
HWY_INLINE void RayMarch::add_grid(const MarchedGrid& grid, const V3& p, M active, MediaAt& sum) const {
  const D d;
  const DI di;
  const LaneCells& c = grid.cells;
  M inside = active;
  const auto cell = [&](V v, float n) {
    inside = hn::And(inside, hn::And(v > 0.0f, v < n * c.cell));
    return hn::Floor(v * c.inverse_cell);
  };
  const V3 at{cell(p.x, c.nx), cell(p.y, c.ny), cell(p.z, c.nz)};
  if (hn::AllFalse(d, inside)) return;
  const V row = at.x * c.ny + at.y;
  const VI index = hn::ConvertTo(di, row) * c.nz_int + hn::ConvertTo(di, at.z);
  const auto kept = [&](VI v) { return hn::IfThenElseZero(hn::RebindMask(di, inside), v); };
  const VI brick = hn::GatherIndex(di, c.brick, kept(index));
  inside = hn::AndNot(hn::RebindMask(d, brick < 0), inside);
  if (hn::AllFalse(d, inside)) return;

  const V3 q = p - at * set(c.cell);
  const V highest = set(c.cell - 1);
  const V x0 = hn::Min(hn::Floor(q.x), highest), y0 = hn::Min(hn::Floor(q.y), highest),
          z0 = hn::Min(hn::Floor(q.z), highest);
  const V fx = q.x - x0, fy = q.y - y0, fz = q.z - z0;
  const VI voxel = (hn::ConvertTo(di, x0) * c.stored + hn::ConvertTo(di, y0)) * c.stored + hn::ConvertTo(di, z0);
  const VI first = kept(voxel + brick);
  const int y = c.stored, x = y * y;
  const EntryPair e00 = entry_pair(c.values, first), e01 = entry_pair(c.values + y, first),
                  e10 = entry_pair(c.values + x, first), e11 = entry_pair(c.values + x + y, first);
  const auto along_z = [&](const EntryPair& e) { return lerp(e.first, e.second, fz); };
  const auto change = [&](const EntryPair& e) { return e.second - e.first; };
  const V z00 = along_z(e00), z01 = along_z(e01), z10 = along_z(e10), z11 = along_z(e11);
  const V near = lerp(z00, z01, fy), far = lerp(z10, z11, fy);
  const V found = lerp(near, far, fx);
  const M any = hn::And(inside, found > 0.0f);
  const auto only = [&](V v) { return hn::IfThenElseZero(any, v); };
  const V density = only(grid.detail.octaves > 0 ? found * detail_factor(grid.detail, p) : found);
  const V3 slope{only(far - near), only(lerp(z01 - z00, z11 - z10, fx)),
                 only(lerp(lerp(change(e00), change(e01), fy), lerp(change(e10), change(e11), fy), fx))};
  const V extinction = density * grid.extinction, scattered = extinction * (grid.seen * grid.albedo);
  sum.gradient += transform(grid.gradient, slope);
  sum.extinction = sum.extinction + extinction;
  sum.albedo = sum.albedo + scattered;
  sum.g = sum.g + scattered * grid.g;
  sum.density = hn::Max(sum.density, density * grid.inverse_maximum);
  sum.tint += scattered * set3(grid.tint);
  if (scene_.holdouts) sum.seen = sum.seen + extinction * grid.seen;
}

HWY_INLINE void RayMarch::add_shape(size_t number, V t, M active, MediaAt& sum) const {
  const MarchedShape& shape = scene_.shapes[number];
  const M inside = hn::And(active, hn::And(t >= shape_begin_[number].load(), t <= shape_end_[number].load()));
  const auto only = [&](V v) { return hn::IfThenElseZero(inside, v); };
  const V extinction = only(set(shape.extinction)), scattered = extinction * (shape.seen * shape.albedo);
  sum.extinction = sum.extinction + extinction;
  sum.albedo = sum.albedo + scattered;
  sum.g = sum.g + scattered * shape.g;
  sum.density = hn::Max(sum.density, only(set(1.0f)));
  sum.tint += scattered * set3(shape.tint);
  if (scene_.holdouts) sum.seen = sum.seen + extinction * shape.seen;
}

MediaAt RayMarch::media_point_by_point(M active, V t) const {
  Lane extinction, albedo, g, density, seen;
  Lanes3 gradient, tint;
  for_each_lane(active, t, [&](size_t lane, MarchedRay& ray, float at) {
    const MarchScene::Point p = scene_.at(ray, at);
    extinction[lane] = p.extinction;
    albedo[lane] = p.albedo;
    g[lane] = p.g;
    density[lane] = p.density;
    gradient.set(lane, p.gradient);
    tint.set(lane, p.tint);
    seen[lane] = p.seen;
  });
  return {extinction.load(), albedo.load(), g.load(), density.load(), gradient.load(), tint.load(), seen.load()};
}

/// Albedo, mean cosine and tint are means.
HWY_INLINE MediaAt RayMarch::media_at(M active, V t) const {
  if (scene_.grids.empty() && scene_.shapes.empty()) return media_point_by_point(active, t);
  const V zero = hn::Zero(D());
  MediaAt sum{zero, zero, zero, zero, zero3(), zero3(), scene_.holdouts ? zero : set(1.0f)};
  for (size_t i = 0; i < scene_.grids.size(); ++i) add_grid(scene_.grids[i], grid_[i].at(t), active, sum);
  for (size_t i = 0; i < scene_.shapes.size(); ++i) add_shape(i, t, active, sum);
  if (scene_.grids.size() + scene_.shapes.size() > 1) {
    const auto share = [&](V part, V whole) {
      return hn::IfThenElseZero(whole > zero, part / hn::Max(whole, set(1e-37f)));
    };
    const V scattered = sum.albedo;
    sum.albedo = share(scattered, scene_.holdouts ? sum.seen : sum.extinction);
    sum.g = share(sum.g, scattered);
    sum.tint = {share(sum.tint.x, scattered), share(sum.tint.y, scattered), share(sum.tint.z, scattered)};
    if (scene_.holdouts) sum.seen = share(sum.seen, sum.extinction);
  } else {
    const auto alone = [&](const auto& medium) {
      sum.seen = set(medium.seen);
      sum.albedo = set(medium.albedo);
      sum.g = set(medium.g);
      sum.tint = set3(medium.tint);
    };
    if (scene_.grids.empty())
      alone(scene_.shapes[0]);
    else
      alone(scene_.grids[0]);
  }
  return sum;
}

HWY_INLINE void RayMarch::step() {
  const D d;
  const V zero = hn::Zero(d);
  const M active = mask_of(busy_);
  V t = t_.load();
  const V begin = begin_.load(), end = end_.load();
  V length = step_length(active, t);
  const V light_step =
      kLightSteps * hn::IfThenElse(extinction_.load() * stride_.load() < kThinStep, stride_.load(), set(1.0f));
  const V late = hn::Max(begin - t, zero);
  t = t + late;
  // As long as what is left of the step; where nothing is, of the next one.
  const V rest = length - late;
  length = hn::Min(hn::IfThenElse(rest > zero, rest, rest + 1.0f), end - t);
  M at_lamp = zero > zero;
  if (near_ & busy_) {
    const V longest = step_near_lamps(t);
    at_lamp = longest < 1.0f;
    length = hn::IfThenElse(at_lamp, hn::Min(length, longest), length);
  }
  const V middle = t + 0.5f * length, next = t + length;
  const MediaAt media = media_at(active, middle);
  const V extinction = hn::IfThenElseZero(active, media.extinction);
  const V thickness = hn::Max(extinction * length, zero);
  extinction_.store(active, extinction);
  const M any = thickness > zero;

  const M ends = hn::Or(middle >= segment_end_.load(), segment_.thickness.load() > kLightThickness);
  const M full = hn::And(any, hn::Or(ends, at_lamp));
  if (!hn::AllFalse(d, full)) {
    add_light(full);
    segment_.clear(full);
    segment_.begin.store(full, t);
    const V offset = offset_.load();
    segment_end_.store(full, (hn::Floor(middle / light_step - offset) + 1.0f + offset) * light_step);
  }

  take(active, t, middle, length, next, thickness, media);
  t_.store(active, next);
  // Where steps are lost in rounding the part has ended, too.
  const M ended = hn::And(active, hn::Or(next >= end, next <= t));
  const M opaque = hn::And(active, (fields_.octaves ? left8_ : left_).load() <= kOpaque);
  if (!hn::AllFalse(d, hn::Or(ended, opaque))) end_parts(ended, opaque);
}

/// What the forward peak leaves of the extinction, as peak_weight() has it; where there is one medium, on average.
HWY_INLINE V RayMarch::scale_of(V albedo, V g) const {
  if (!scene_.mixed_peaks) return set(scene_.scaled_extinction);
  const V positive = hn::Max(g, hn::Zero(D())),
          share = hn::Min(set(1.0f), positive * (1 / static_cast<float>(kNarrowPeak)));
  const V squares = share * share;
  return 1.0f - albedo * (positive * positive * squares * squares);
}

/// What a step takes of the light that is left, with the extinction and less of it.
HWY_INLINE void RayMarch::take(M active, V t, V middle, V length, V next, V thickness, const MediaAt& media) {
  const M any = thickness > 0.0f;
  const V e8 = one_minus_attenuation(thickness * 0.125f), e4 = of_square(e8), e2 = of_square(e4), e = of_square(e2);
  // Without a forward peak both are the same to the last bit.
  const V scale = scale_of(media.albedo, media.g);
  const V e_scaled = hn::AllTrue(D(), scale == 1.0f) ? e : one_minus_attenuation(thickness * scale);
  const V left = left_.load(), left_scaled = left_scaled_.load(), depth = depth_.load(), peaks = peaks_.load();
  const V w = left * e, scaled = left_scaled * e_scaled;
  const V w2 = left2_.load() * e2, w4 = left4_.load() * e4, w8 = left8_.load() * e8;
  const V peaked = thickness * (1.0f - scale), peaks_in_middle = peaks + 0.5f * peaked;
  const auto seen = [&](V v) { return scene_.holdouts ? v * media.seen : v; };
  const V w_seen = seen(w), thickness_seen = seen(thickness), scattered = thickness_seen * media.albedo;
  if (batch_.deep)
    keep_step(scene_.emits ? active : any, t, next, w_seen,
              scene_.holdouts ? 1.0f - opacity_.load() - w_seen : left - w);
  segment_.end.store(any, next);
  segment_.w.add(w_seen);
  segment_.w2.add(seen(w2));
  segment_.w4.add(seen(w4));
  segment_.w8.add(seen(w8));
  segment_.scaled.add(seen(scaled));
  segment_.unpeaked.add(seen(scaled / scale));
  segment_.thickness.add(thickness_seen);
  segment_.distance.add(thickness_seen * middle);
  segment_.peaks.add(thickness_seen * peaks_in_middle);
  segment_.albedo.add(scattered);
  segment_.g.add(thickness_seen * media.g);
  if (scene_.mixed_tints) {
    segment_.tint[0].add(scattered * media.tint.x);
    segment_.tint[1].add(scattered * media.tint.y);
    segment_.tint[2].add(scattered * media.tint.z);
  }
  if (scene_.emits) {
    Lane straight, by_peaks, before;
    const V inverse = 1.0f / hn::Max(media.extinction, set(1e-37f));
    straight.store(hn::IfThenElse(any, w * inverse, left * length));
    by_peaks.store(hn::IfThenElse(any, scaled / scale * inverse, left_scaled * length));
    before.store(peaks_in_middle);
    for_each_lane(active, middle, [&](size_t lane, MarchedRay& ray, float at) {
      scene_.emit(ray, at, straight[lane], by_peaks[lane], before[lane]);
    });
  }
  left_.store(left - w);
  left2_.store(left2_.load() - w2);
  left4_.store(left4_.load() - w4);
  left8_.store(left8_.load() - w8);
  left_scaled_.store(left_scaled - scaled);
  depth_.store(depth + thickness);
  peaks_.store(peaks + peaked);

  // Distances from where anything was seen first keep what rounding would take from their squares' mean.
  const M met = hn::And(any, opacity_.load() <= 0.0f);
  first_.store(met, middle);
  const V behind = middle - first_.load();
  opacity_.add(w_seen);
  distance_.add(w_seen * behind);
  distance2_.add(w_seen * behind * behind);
  density_.add(w_seen * media.density);
  gradient_.store(gradient_.load() + w_seen /
                                         (brume::HWY_NAMESPACE::length(media.gradient) + scene_.steps.gentle_gradient) *
                                         media.gradient);
}

void RayMarch::keep_step(M mask, V t, V next, V w, V left) {
  Lane begin, end, taken, left_behind;
  begin.store(t);
  end.store(next);
  taken.store(w);
  left_behind.store(left);
  for_each_lane(mask, [&](size_t lane, MarchedRay& ray) {
    if (ray.deep) ray.deep->add(begin[lane], end[lane], taken[lane], left_behind[lane]);
  });
}

void RayMarch::end_parts(M ended, M opaque) {
  uint32_t finished = bits_of(opaque);
  for_each_lane(hn::AndNot(opaque, ended), [&](size_t lane, MarchedRay& ray) {
    if (++part_[lane] == ray.last_part)
      finished |= 1u << lane;
    else
      begin_part(lane);
  });
  if (!finished) return;
  const M done = mask_of(finished);
  add_light(done);
  add_fields(done);
  for_each_lane(done, [&](size_t lane, MarchedRay&) { finish(lane); });
}

/// Adds the light that segments scatter towards the eye: of suns and lamps at once, fields of nodes when the segments
/// since they were looked up last are as long as nodes are apart.
void RayMarch::add_light(M mask) {
  mask = hn::And(mask, segment_.thickness.load() > 0.0f);
  if (hn::AllFalse(D(), mask)) return;
  const float spacing = scene_.steps.field_spacing;
  const auto longer = [&](const Lane& end, float than) {
    return hn::And(mask, end.load() - wide_.begin.load() > than);
  };
  add_fields(longer(segment_.end, 2 * spacing));
  for (size_t k = 0; k < scene_.lights.size(); ++k) add_turned_light(k, mask);
  wide_.join(segment_, mask);
  add_fields(hn::Or(longer(wide_.end, spacing), hn::And(mask, wide_.thickness.load() > kNodeThickness)));
}

/// Where points lie between the nodes is found side by side, the fields of each point, too.
void RayMarch::add_fields(M mask) {
  mask = hn::And(mask, wide_.thickness.load() > 0.0f);
  const D d;
  if (hn::AllFalse(d, mask)) return;
  const NodeTable& table = fields_.table;
  const ivec3& n = table.lattice.n;
  const V inverse = 1.0f / hn::Max(wide_.thickness.load(), set(1e-37f)), distance = wide_.distance.load() * inverse;
  const Cell cell(place_at_nodes(mask, distance), n);
  HWY_ALIGN int32_t first[hn::MaxLanes(DI())];
  hn::Store((cell.node[0] * n.y + cell.node[1]) * n.z + cell.node[2], DI(), first);
  Lane weight[8], albedo;
  for (int corner = 0; corner < 8; ++corner) {
    const auto along = [&](int axis, int bit) { return corner & bit ? cell.f[axis] : 1.0f - cell.f[axis]; };
    weight[corner].store(along(0, 4) * along(1, 2) * along(2, 1));
  }
  albedo.store(wide_.albedo.load() * inverse);

  const size_t count = table.count, y = count * static_cast<size_t>(n.z), x = y * static_cast<size_t>(n.y);
  for_each_lane(mask, [&](size_t lane, MarchedRay& ray) {
    GuideSums& to = *ray.sums;
    const float* const base = table.values.data() + static_cast<size_t>(first[lane]) * count;
    const V w = set(wide_.w[lane]), scaled = set(wide_.scaled[lane]);
    V corners[8];
    for (size_t c = 0; c < 8; ++c) corners[c] = set(weight[c][lane]);
    HWY_ALIGN float at[NodeTable::kMost];
    for (size_t m = 0; m < count; m += hn::Lanes(d)) {
      const auto corner = [&](size_t c, size_t offset) { return corners[c] * hn::LoadU(d, base + m + offset); };
      V sum = corner(0, 0) + corner(1, count);
      sum = sum + (corner(2, y) + corner(3, y + count));
      sum = sum + (corner(4, x) + corner(5, x + count));
      sum = sum + (corner(6, x + y) + corner(7, x + y + count));
      hn::Store(sum, d, at + m);
      hn::StoreU(hn::LoadU(d, to.plain.data() + m) + w * sum, d, to.plain.data() + m);
      hn::StoreU(hn::LoadU(d, to.scaled.data() + m) + scaled * sum, d, to.scaled.data() + m);
    }
    for (size_t g = 0; fields_.groups && g < fields_.groups->size(); ++g) {
      const NodeFields::Slots& slots = (*fields_.groups)[g];
      GuideSums::FieldSums& sums = to.fields[g];
      const float tail = at[slots.tail()];
      sums.tail[0] += wide_.w2[lane] * tail;
      sums.tail[1] += wide_.w4[lane] * tail;
      sums.tail[2] += wide_.w8[lane] * tail;
      if (!slots.forward) continue;
      sums.single += wide_.w[lane] * albedo[lane] * at[slots.single];
      sums.forward += wide_.unpeaked[lane] * albedo[lane] * at[slots.forward];
    }
    if (!(scene_.mixed_tints || ray.deep) || !(wide_.albedo[lane] > 0)) return;
    for (size_t k = 0; k < scene_.lights.size(); ++k) {
      ray.turned[k].single = std::exchange(light_[k].wide_single[lane], 0.0f);
      ray.turned[k].forward = std::exchange(light_[k].wide_forward[lane], 0.0f);
    }
    if (scene_.mixed_tints)
      scene_.set_tint(ray, dvec3(wide_.tint[0][lane], wide_.tint[1][lane], wide_.tint[2][lane]) /
                               static_cast<double>(wide_.albedo[lane]));
    const auto add_scattered = [&](dvec3& direct, dvec3& indirect) {
      scene_.add_scattered(ray, fields_, at, wide_.w[lane], wide_.scaled[lane], wide_.unpeaked[lane], albedo[lane],
                           direct, indirect);
    };
    if (scene_.mixed_tints) add_scattered(to.tinted_direct, to.tinted_indirect);
    if (!ray.deep) return;
    dvec3 direct(0), indirect(0);
    add_scattered(direct, indirect);
    ray.deep->light_up(wide_.end[lane], wide_.w[lane], vec3(direct + indirect));
  });
  wide_.clear(mask);
}

/// On the fields' lattice, where the light was solved.
HWY_INLINE V3 RayMarch::place_at_nodes(M mask, V t) const {
  if (!scene_.follows) return nodes_.at(t);
  Lanes3 moved;
  for_each_lane(mask, t, [&](size_t lane, MarchedRay& ray, float at) {
    moved.set(lane, vec3(fields_.table.lattice.to_lattice(scene_.in_light(ray, at))));
  });
  return moved.load();
}

/// Of one of NodeValues.
HWY_INLINE V RayMarch::at_nodes(const float* values, const Cell& cell, M mask) const {
  const Lattice& nodes = scene_.nodes;
  const int row = nodes.row(), plane = row * nodes.n.y;
  const VI index =
      hn::IfThenElseZero(hn::RebindMask(DI(), mask), cell.node[0] * plane + cell.node[1] * row + cell.node[2]);
  const auto along = [&](int offset) { return between_entries(values + offset, index, cell.f[2]); };
  return lerp(lerp(along(0), along(row), cell.f[1]), lerp(along(plane), along(plane + row), cell.f[1]), cell.f[0]);
}

HWY_INLINE V RayMarch::sun_depth(const SunDepth& sun, const V3& place, M mask) const {
  const ivec3& n = sun.nodes();
  const Cell cell(place, n);
  const VI column = cell.node[1] * n.z + cell.node[2];
  const VI index = hn::IfThenElseZero(hn::RebindMask(DI(), mask), column * n.x + cell.node[0]);
  const auto along = [&](int32_t offset) {
    const ShortPair roots = short_pair(sun.roots() + offset, index);
    const V a = SunDepth::kRootStep * roots.first, b = SunDepth::kRootStep * roots.second;
    return lerp(a * a, b * b, cell.f[0]);
  };
  const int32_t next_v = n.x, next_u = n.x * n.z;
  return lerp(lerp(along(0), along(next_v), cell.f[2]), lerp(along(next_u), along(next_u + next_v), cell.f[2]),
              cell.f[1]);
}

HWY_INLINE void RayMarch::add_turned_light(size_t k, M mask) {
  const MarchedLight& known = scene_.lights[k];
  TurnedLanes& light = light_[k];
  const V inverse = 1.0f / hn::Max(segment_.thickness.load(), set(1e-37f));
  const V distance = segment_.distance.load() * inverse, before = segment_.peaks.load() * inverse;
  V visible = set(1.0f), depth = hn::Zero(D());
  if (known.visible || known.depth) {
    const V3 place = place_at_nodes(mask, distance) * to_lights_ +
                     V3{set(lights_origin_.x), set(lights_origin_.y), set(lights_origin_.z)};
    const Cell cell(place, scene_.nodes.n);
    if (known.visible) visible = at_nodes(known.visible, cell, mask);
    if (known.depth) depth = at_nodes(known.depth, cell, mask);
  }
  if (known.varies) {
    Lane g, towards_middle;
    g.store(segment_.g.load() * inverse);
    towards_middle.store(depth);
    Lane turn;
    uint32_t tabulated = 0;
    for_each_lane(mask, distance, [&](size_t lane, MarchedRay& ray, float t) {
      const MarchScene::Turned turned = scene_.turn(ray, k, t, g[lane], towards_middle[lane]);
      if (turned == MarchScene::Turned::kAll) light.set(lane, ray.turned[k]);
      if (turned != MarchScene::Turned::kTabulated) return;
      light.irradiance[lane] = ray.turned[k].irradiance;
      light.mean_depth[lane] = ray.turned[k].mean_depth;
      turn[lane] = ray.turned[k].turn;
      tabulated |= 1u << lane;
    });
    if (tabulated) light.look_up(scene_.turns.data(), turn.load(), mask_of(tabulated));
  }
  // Optical depths towards its middle, and of all directions to it.
  const V tau = known.sun ? sun_depth(*known.sun, light.place.at(distance), mask) : depth;
  const V mean_tau = known.sun ? tau : light.mean_depth.load();
  const V v16 = exponential(tau * (-1.0f / 16)), v8 = v16 * v16, v4 = v8 * v8, v2 = v4 * v4;
  const V arriving = known.sun ? v2 * v2 : exponential(-mean_tau);
  const V irradiance = hn::IfThenElseZero(mask, light.irradiance.load() * (segment_.albedo.load() * inverse) * visible);
  const V lit = segment_.w.load() * irradiance;
  // ForwardPeak::repeated times what arrives: exponentials that would overflow are multiplied first.
  const V scale = scale_of(segment_.albedo.load() * inverse, segment_.g.load() * inverse);
  const V peak = hn::Min((1.0f - scale) * tau + before, set(kDeepestPeak));
  V terms = light.peak[6].load();
  for (size_t i = 6; i-- > 0;) terms = light.peak[i].load() + peak * terms;
  const V repeated = arriving * (peak * terms) + light.peak[7].load() * (exponential(peak - mean_tau) - arriving);
  const V single = lit * (light.phase[0].load() * arriving), forward = lit * hn::Max(repeated, hn::Zero(D()));
  light.single.add(single);
  light.forward.add(forward);
  light.wide_single.add(single);
  light.wide_forward.add(forward);
  light.octave[0].add(segment_.w2.load() * irradiance * (light.phase[1].load() * v2));
  light.octave[1].add(segment_.w4.load() * irradiance * (light.phase[2].load() * v4));
  light.octave[2].add(segment_.w8.load() * irradiance * (light.phase[3].load() * v8));
  const V even = lit * (0.25f * std::numbers::inv_pi_v<float>);
  const V softened[4] = {v2, v4, v8, v16};
  for (size_t i = 0; i < 4; ++i) light.soft[i].add(even * softened[i]);
}

void MarchRays(const MarchScene& scene, const MarchedFields& fields, MarchBatch& batch) {
  RayMarch(scene, fields, batch).run();
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(MarchRays);

void march_rays(const MarchScene& scene, const MarchedFields& fields, MarchBatch& batch) {
  HWY_DYNAMIC_DISPATCH(MarchRays)(scene, fields, batch);
}

}  // namespace brume
#endif
