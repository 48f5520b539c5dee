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

#include "volume/lane_grid.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/cell_walk.h"

// Of the step for each free path behind the eye's first ones.
constexpr float kStepGrowth = 0.25f, kGrowingDepth = 2, kLongestStep = 4;
// A step may be longer by the ray's stride as far as the medium at the last one was thinner than this.
constexpr float kThinStep = 0.03f;
// Steps that share one look-up of suns and lamps: so many at the start of a ray, of no more optical depth than this.
constexpr float kLightSteps = 2, kLightThickness = 0.12f;
// Optical depth of the steps that share one look-up of the fields at nodes.
constexpr float kNodeThickness = 0.5f;
constexpr float kOpaque = 2e-3f;     // transmittance of an eighth of the extinction at which a ray ends
constexpr float kDeepestPeak = 600;  // as ForwardPeak

/// e^r - 1 for |r| below 0.35, relative error below 1e-7.
HWY_INLINE V small_expm1(V r) {
  V p = hn::Add(set(1.0f / 120), hn::Mul(r, hn::Add(set(1.0f / 720), hn::Mul(r, set(1.0f / 5040)))));
  p = hn::Add(set(1.0f / 6), hn::Mul(r, hn::Add(set(1.0f / 24), hn::Mul(r, p))));
  return hn::Add(r, hn::Mul(hn::Mul(r, r), hn::Add(set(0.5f), hn::Mul(r, p))));
}

/// 2^k and e^r - 1 of which e^x = 2^k e^r. Below e^-87 as there.
struct SplitExponential {
  V power, rest;
  HWY_INLINE explicit SplitExponential(V x) {
    const V within = hn::Min(hn::Max(x, set(-87.0f)), set(88.0f));
    const V k = hn::Floor(hn::Add(hn::Mul(within, set(std::numbers::log2e_v<float>)), set(0.5f)));
    // The high part of ln 2 has so few bits that its products with k are exact.
    const V r = hn::Sub(hn::Sub(within, hn::Mul(k, set(0.693359375f))), hn::Mul(k, set(-2.12194440e-4f)));
    rest = small_expm1(r);
    const DI di;
    power = hn::BitCast(D(), hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, k), hn::Set(di, 127))));
  }
};

/// e^x, relative error below 3e-7; 0 below -87.
HWY_INLINE V exponential(V x) {
  const SplitExponential e(x);
  return hn::IfThenZeroElse(hn::Lt(x, set(-87.0f)), hn::Add(e.power, hn::Mul(e.power, e.rest)));
}

/// 1 - e^-x for x >= 0, relative error below 3e-7 for small x, too.
HWY_INLINE V one_minus_attenuation(V x) {
  const SplitExponential e(hn::Neg(x));
  return hn::Sub(hn::Sub(set(1.0f), e.power), hn::Mul(e.power, e.rest));
}

/// 1 - q^2 of 1 - q.
HWY_INLINE V of_square(V one_minus_q) {
  return hn::Mul(one_minus_q, hn::Sub(set(2.0f), one_minus_q));
}

/// 16-bit numbers of a table and those behind them. @param index  of the first
struct ShortPair {
  V first, second;
};
HWY_INLINE ShortPair short_pair(const uint16_t* table, VI index) {
  const DI di;
  const DU du;
#if HWY_TARGET <= HWY_AVX2
  const VI both = hn::GatherOffset(di, reinterpret_cast<const int32_t*>(table), hn::Add(index, index));
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

/// Extinction, its gradient and what goes with it, of all media at a point of each ray.
struct Seen {
  V extinction, albedo, g, density;
  V3 gradient, tint;
};

/// As many rays as there are lanes, on their way.
class Marching {
 public:
  static constexpr size_t kMost = RayQueue::kMost;
  using Lane = float[kMost];

  Marching(const MarchScene& scene, std::span<MarchedRay> rays, std::span<const float> parts, RayMarchHost& host)
      : scene_(scene), rays_(rays), parts_(parts), host_(host) {}

  void run() {
    const size_t lanes = hn::Lanes(D());
    for (size_t lane = 0; lane < lanes; ++lane) refill(lane);
    while (busy_) step();
  }

 private:
  static HWY_INLINE V get(const Lane& lane) { return hn::Load(D(), lane); }
  static HWY_INLINE void put(V v, Lane& lane) { hn::Store(v, D(), lane); }
  static HWY_INLINE void add(V v, Lane& lane) { put(hn::Add(get(lane), v), lane); }

  struct Place {
    HWY_ALIGN Lane start[3], along[3];
    HWY_INLINE V3 at(V t) const {
      const auto axis = [&](int a) { return hn::Add(get(start[a]), hn::Mul(get(along[a]), t)); };
      return {axis(0), axis(1), axis(2)};
    }
    void set_lane(size_t lane, const MarchedRay::Place& place) {
      for (int a = 0; a < 3; ++a) {
        start[a][lane] = place.start[a];
        along[a][lane] = place.along[a];
      }
    }
  };
  struct Sun {
    Place place;
    HWY_ALIGN Lane phase[4], peak[8];
    HWY_ALIGN Lane single, forward, octave[3], soft[4];
  };
  /// MarchedPiece, of each lane.
  struct Piece {
    HWY_ALIGN Lane begin, end, w, w2, w4, w8, scaled, thickness, distance, depth, albedo, g, tint[3];

    MarchedPiece of(size_t lane) const {
      return {begin[lane],
              end[lane],
              w[lane],
              w2[lane],
              w4[lane],
              w8[lane],
              scaled[lane],
              thickness[lane],
              distance[lane],
              depth[lane],
              albedo[lane],
              g[lane],
              {tint[0][lane], tint[1][lane], tint[2][lane]}};
    }
    /// Begins anew at the end, in the lanes of a mask.
    HWY_INLINE void clear(M mask) {
      put(hn::IfThenElse(mask, get(end), get(begin)), begin);
      const auto zero = [&](Lane& lane) { put(hn::IfThenZeroElse(mask, get(lane)), lane); };
      for (Lane* lane : {&w, &w2, &w4, &w8, &scaled, &thickness, &distance, &depth, &albedo, &g}) zero(*lane);
      for (Lane& lane : tint) zero(lane);
    }
    void clear_lane(size_t lane) {
      for (Lane* of : {&begin, &end, &w, &w2, &w4, &w8, &scaled, &thickness, &distance, &depth, &albedo, &g})
        (*of)[lane] = 0;
      for (Lane& of : tint) of[lane] = 0;
    }
    /// Joins the piece that follows, in the lanes of a mask.
    HWY_INLINE void join(const Piece& next, M mask, bool tinted) {
      const M fresh = hn::And(mask, hn::Le(get(thickness), hn::Zero(D())));
      put(hn::IfThenElse(fresh, get(next.begin), get(begin)), begin);
      put(hn::IfThenElse(mask, get(next.end), get(end)), end);
      const auto join_sum = [&](const Lane& from, Lane& to) { add(hn::IfThenElseZero(mask, get(from)), to); };
      join_sum(next.w, w);
      join_sum(next.w2, w2);
      join_sum(next.w4, w4);
      join_sum(next.w8, w8);
      join_sum(next.scaled, scaled);
      join_sum(next.thickness, thickness);
      join_sum(next.distance, distance);
      join_sum(next.depth, depth);
      join_sum(next.albedo, albedo);
      join_sum(next.g, g);
      for (int c = 0; tinted && c < 3; ++c) join_sum(next.tint[c], tint[c]);
    }
  };

  template <class Visit>
  HWY_INLINE void for_each_lane(M mask, Visit&& visit) const {
    for (uint32_t bits = bits_of(mask); bits; bits &= bits - 1) {
      const auto lane = static_cast<size_t>(std::countr_zero(bits));
      visit(lane, static_cast<size_t>(slot_[lane]));
    }
  }

  /// Gives a lane the next ray, past those that meet nothing.
  void refill(size_t lane) {
    busy_ &= ~(1u << lane);
    while (next_ < rays_.size() && rays_[next_].first_part == rays_[next_].last_part) ++next_;
    if (next_ == rays_.size()) return;
    const MarchedRay& ray = rays_[next_];
    slot_[lane] = static_cast<int32_t>(next_++);
    busy_ |= 1u << lane;
    for (size_t i = 0; i < scene_.grids.size(); ++i) grid_[i].set_lane(lane, ray.grid[i]);
    nodes_.set_lane(lane, ray.nodes);
    for (size_t k = 0; k < scene_.suns.size(); ++k) {
      Sun& sun = sun_[k];
      sun.place.set_lane(lane, ray.sun[k].place);
      for (size_t i = 0; i < 4; ++i) sun.phase[i][lane] = ray.sun[k].phase[i];
      for (size_t i = 0; i < 8; ++i) sun.peak[i][lane] = ray.sun[k].peak[i];
      sun.single[lane] = sun.forward[lane] = 0;
      for (Lane& sum : sun.octave) sum[lane] = 0;
      for (Lane& sum : sun.soft) sum[lane] = 0;
    }
    stride_[lane] = ray.stride;
    offset_[lane] = ray.offset;
    passed_[lane] = passed2_[lane] = passed4_[lane] = passed8_[lane] = passed_scaled_[lane] = 1;
    depth_[lane] = extinction_[lane] = 0;
    seen_[lane] = first_[lane] = distance_[lane] = distance2_[lane] = density_[lane] = 0;
    for (Lane& sum : gradient_) sum[lane] = 0;
    piece_.clear_lane(lane);
    wide_.clear_lane(lane);
    part_[lane] = ray.first_part;
    begin_part(lane);
  }

  /// Steps of neighbouring pixels begin at the same distances from the eye, wherever their cells begin.
  void begin_part(size_t lane) {
    const float* const part = parts_.data() + 2 * static_cast<size_t>(part_[lane]);
    begin_[lane] = part[0];
    end_[lane] = part[1];
    t_[lane] = (std::floor(part[0] / stride_[lane] - offset_[lane]) + offset_[lane]) * stride_[lane];
    piece_end_[lane] = t_[lane];
  }

  void finish(size_t lane) {
    MarchedRay& ray = rays_[static_cast<size_t>(slot_[lane])];
    ray.passed = passed_[lane];
    ray.passed_scaled = passed_scaled_[lane];
    ray.seen = seen_[lane];
    ray.first = first_[lane];
    ray.distance = distance_[lane];
    ray.distance2 = distance2_[lane];
    ray.density = density_[lane];
    for (size_t a = 0; a < 3; ++a) ray.gradient[a] = gradient_[a][lane];
    for (size_t k = 0; k < scene_.suns.size(); ++k) {
      MarchedRay::SunLight& light = ray.light[k];
      const Sun& sun = sun_[k];
      light.single = sun.single[lane];
      light.forward = sun.forward[lane];
      for (size_t i = 0; i < 3; ++i) light.octave[i] = sun.octave[i][lane];
      for (size_t i = 0; i < 4; ++i) light.soft[i] = sun.soft[i][lane];
    }
    refill(lane);
  }

  HWY_INLINE void step();
  HWY_INLINE V step_length(M active, V t) const;
  HWY_INLINE Seen look(M active, V t) const;
  HWY_INLINE void look_in(const MarchedGrid& grid, const V3& p, M active, Seen& seen) const;
  void look_through_host(M active, V t, Seen& seen) const;
  void add_light(M mask);
  HWY_INLINE void add_sun(size_t k, M mask);
  void add_fields(M mask);
  void add_known_fields(M mask);
  void end_parts(M ended, M opaque);

  const MarchScene& scene_;
  const std::span<MarchedRay> rays_;
  const std::span<const float> parts_;
  RayMarchHost& host_;
  size_t next_ = 0;
  uint32_t busy_ = 0;
  HWY_ALIGN int32_t slot_[kMost] = {};
  uint32_t part_[kMost] = {};
  Place grid_[kMostMarchedGrids] = {}, nodes_ = {};
  Sun sun_[kMostMarchedSuns] = {};
  HWY_ALIGN Lane stride_ = {}, offset_ = {}, t_ = {}, begin_ = {}, end_ = {}, piece_end_ = {};
  HWY_ALIGN Lane passed_ = {}, passed2_ = {}, passed4_ = {}, passed8_ = {}, passed_scaled_ = {}, depth_ = {};
  HWY_ALIGN Lane extinction_ = {};  // at the last step
  HWY_ALIGN Lane seen_ = {}, first_ = {}, distance_ = {}, distance2_ = {}, density_ = {}, gradient_[3] = {};
  Piece piece_ = {}, wide_ = {};
};

HWY_INLINE V Marching::step_length(M active, V t) const {
  const V stride = get(stride_), one = set(1.0f);
  V length = hn::IfThenElse(hn::Lt(hn::Mul(get(extinction_), stride), set(kThinStep)), stride, one);
  const V deeper = hn::Max(hn::Sub(get(depth_), set(kGrowingDepth)), hn::Zero(D()));
  length = hn::Mul(length, hn::Min(set(kLongestStep), hn::Add(one, hn::Mul(set(kStepGrowth), deeper))));
  if (!scene_.even) return length;
  HWY_ALIGN Lane from, steps = {};
  put(t, from);
  for_each_lane(active, [&](size_t lane, size_t ray) { steps[lane] = host_.even_steps(ray, from[lane], end_[lane]); });
  return hn::Max(length, hn::Mul(stride, get(steps)));
}

/// Adds what a grid has at a point to what all media have; albedo and the like times extinction.
HWY_INLINE void Marching::look_in(const MarchedGrid& grid, const V3& p, M active, Seen& seen) const {
  const D d;
  const DI di;
  const LaneCells& c = grid.cells;
  const V zero = hn::Zero(d);
  M inside = active;
  const auto cell = [&](V v, float n) {
    inside = hn::And(inside, hn::And(hn::Gt(v, zero), hn::Lt(v, set(n * c.cell))));
    return hn::Floor(hn::Mul(v, set(c.inverse_cell)));
  };
  const V3 at{cell(p.x, c.nx), cell(p.y, c.ny), cell(p.z, c.nz)};
  if (hn::AllFalse(d, inside)) return;
  const V row = hn::Add(hn::Mul(at.x, set(c.ny)), at.y);
  const VI index = hn::Add(hn::Mul(hn::ConvertTo(di, row), hn::Set(di, c.nz_int)), hn::ConvertTo(di, at.z));
  const auto kept = [&](VI v) { return hn::IfThenElseZero(hn::RebindMask(di, inside), v); };
  const VI brick = hn::GatherIndex(di, c.brick, kept(index));
  inside = hn::AndNot(hn::RebindMask(d, hn::Lt(brick, hn::Zero(di))), inside);
  if (hn::AllFalse(d, inside)) return;

  const V highest = set(c.cell - 1), size = set(c.cell);
  const auto within = [&](V v, V from) { return hn::Sub(v, hn::Mul(from, size)); };
  const V3 q{within(p.x, at.x), within(p.y, at.y), within(p.z, at.z)};
  const V x0 = hn::Min(hn::Floor(q.x), highest), y0 = hn::Min(hn::Floor(q.y), highest),
          z0 = hn::Min(hn::Floor(q.z), highest);
  const V fx = hn::Sub(q.x, x0), fy = hn::Sub(q.y, y0), fz = hn::Sub(q.z, z0);
  const VI stored = hn::Set(di, c.stored);
  const VI voxel = hn::Add(hn::Mul(hn::Add(hn::Mul(hn::ConvertTo(di, x0), stored), hn::ConvertTo(di, y0)), stored),
                           hn::ConvertTo(di, z0));
  const VI first = kept(hn::Add(voxel, brick));
  const int y = c.stored, x = y * y;
  const EntryPair e00 = entry_pair(c.values, first), e01 = entry_pair(c.values + y, first),
                  e10 = entry_pair(c.values + x, first), e11 = entry_pair(c.values + x + y, first);
  const auto along_z = [&](const EntryPair& e) { return lerp(e.first, e.second, fz); };
  const auto change = [&](const EntryPair& e) { return hn::Sub(e.second, e.first); };
  const V z00 = along_z(e00), z01 = along_z(e01), z10 = along_z(e10), z11 = along_z(e11);
  const V near = lerp(z00, z01, fy), far = lerp(z10, z11, fy);
  const V found = lerp(near, far, fx);
  const M any = hn::And(inside, hn::Gt(found, zero));
  const auto only = [&](V v) { return hn::IfThenElseZero(any, v); };
  const V density = only(found);
  const V3 slope{only(hn::Sub(far, near)), only(lerp(hn::Sub(z01, z00), hn::Sub(z11, z10), fx)),
                 only(lerp(lerp(change(e00), change(e01), fy), lerp(change(e10), change(e11), fy), fx))};
  const V3 gradient = transform(grid.gradient, slope);
  seen.gradient = {hn::Add(seen.gradient.x, gradient.x), hn::Add(seen.gradient.y, gradient.y),
                   hn::Add(seen.gradient.z, gradient.z)};
  const V extinction = hn::Mul(density, set(grid.extinction)), scattered = hn::Mul(extinction, set(grid.albedo));
  seen.extinction = hn::Add(seen.extinction, extinction);
  seen.albedo = hn::Add(seen.albedo, scattered);
  seen.g = hn::Add(seen.g, hn::Mul(scattered, set(grid.g)));
  seen.density = hn::Max(seen.density, hn::Mul(density, set(grid.inverse_maximum)));
  seen.tint = {hn::Add(seen.tint.x, hn::Mul(scattered, set(grid.tint[0]))),
               hn::Add(seen.tint.y, hn::Mul(scattered, set(grid.tint[1]))),
               hn::Add(seen.tint.z, hn::Mul(scattered, set(grid.tint[2])))};
}

void Marching::look_through_host(M active, V t, Seen& seen) const {
  HWY_ALIGN Lane at, extinction = {}, albedo = {}, g = {}, density = {}, gradient[3] = {}, tint[3] = {};
  put(t, at);
  for_each_lane(active, [&](size_t lane, size_t ray) {
    const RayMarchHost::Point p = host_.look(ray, at[lane]);
    extinction[lane] = p.extinction;
    density[lane] = p.density;
    albedo[lane] = p.albedo;
    g[lane] = p.g;
    for (size_t a = 0; a < 3; ++a) {
      gradient[a][lane] = p.gradient[a];
      tint[a][lane] = p.tint[a];
    }
  });
  seen = {get(extinction),
          get(albedo),
          get(g),
          get(density),
          {get(gradient[0]), get(gradient[1]), get(gradient[2])},
          {get(tint[0]), get(tint[1]), get(tint[2])}};
}

/// Albedo, mean cosine and tint are means.
HWY_INLINE Seen Marching::look(M active, V t) const {
  const V zero = hn::Zero(D());
  Seen seen{zero, zero, zero, zero, {zero, zero, zero}, {zero, zero, zero}};
  if (scene_.grids.empty()) {
    look_through_host(active, t, seen);
    return seen;
  }
  for (size_t i = 0; i < scene_.grids.size(); ++i) look_in(scene_.grids[i], grid_[i].at(t), active, seen);
  const auto share = [&](V part, V whole) {
    return hn::IfThenElseZero(hn::Gt(whole, zero), hn::Div(part, hn::Max(whole, set(1e-37f))));
  };
  if (scene_.grids.size() > 1) {
    const V scattered = seen.albedo;
    seen.albedo = share(scattered, seen.extinction);
    seen.g = share(seen.g, scattered);
    seen.tint = {share(seen.tint.x, scattered), share(seen.tint.y, scattered), share(seen.tint.z, scattered)};
  } else {
    const MarchedGrid& grid = scene_.grids[0];
    seen.albedo = set(grid.albedo);
    seen.g = set(grid.g);
    seen.tint = {set(grid.tint[0]), set(grid.tint[1]), set(grid.tint[2])};
  }
  return seen;
}

HWY_INLINE void Marching::step() {
  const D d;
  const V zero = hn::Zero(d);
  const M active = mask_of(busy_);
  V t = get(t_);
  const V begin = get(begin_), end = get(end_);
  V length = step_length(active, t);
  const V light_step =
      hn::Mul(set(kLightSteps),
              hn::IfThenElse(hn::Lt(hn::Mul(get(extinction_), get(stride_)), set(kThinStep)), get(stride_), set(1.0f)));
  const V late = hn::Max(hn::Sub(begin, t), zero);
  t = hn::Add(t, late);
  // As long as what is left of the step; where nothing is, of the next one.
  const V left = hn::Sub(length, late);
  length = hn::Min(hn::IfThenElse(hn::Gt(left, zero), left, hn::Add(left, set(1.0f))), hn::Sub(end, t));
  const V middle = hn::Add(t, hn::Mul(set(0.5f), length)), next = hn::Add(t, length);
  const Seen seen = look(active, middle);
  const V extinction = hn::IfThenElseZero(active, seen.extinction);
  const V thickness = hn::Max(hn::Mul(extinction, length), zero);
  put(hn::IfThenElse(active, extinction, get(extinction_)), extinction_);
  const M any = hn::Gt(thickness, zero);

  const M full =
      hn::And(any, hn::Or(hn::Ge(middle, get(piece_end_)), hn::Gt(get(piece_.thickness), set(kLightThickness))));
  if (!hn::AllFalse(d, full)) {
    add_light(full);
    piece_.clear(full);
    put(hn::IfThenElse(full, t, get(piece_.begin)), piece_.begin);
    const V offset = get(offset_);
    const V last = hn::Add(hn::Add(hn::Floor(hn::Sub(hn::Div(middle, light_step), offset)), set(1.0f)), offset);
    put(hn::IfThenElse(full, hn::Mul(last, light_step), get(piece_end_)), piece_end_);
  }

  // What a step takes of what passes, with the extinction and less of it.
  const V e8 = one_minus_attenuation(hn::Mul(thickness, set(0.125f))), e4 = of_square(e8), e2 = of_square(e4);
  // Without a forward peak both are the same to the last bit.
  const V e = of_square(e2), e_scaled = scene_.scaled_extinction == 1
                                            ? e
                                            : one_minus_attenuation(hn::Mul(thickness, set(scene_.scaled_extinction)));
  const V passed = get(passed_), passed_scaled = get(passed_scaled_), depth = get(depth_);
  const V w = hn::Mul(passed, e), scaled = hn::Mul(passed_scaled, e_scaled);
  const V w2 = hn::Mul(get(passed2_), e2), w4 = hn::Mul(get(passed4_), e4), w8 = hn::Mul(get(passed8_), e8);
  const V depth_in_middle = hn::Add(depth, hn::Mul(set(0.5f), thickness)), scattered = hn::Mul(thickness, seen.albedo);
  put(hn::IfThenElse(any, next, get(piece_.end)), piece_.end);
  add(w, piece_.w);
  add(w2, piece_.w2);
  add(w4, piece_.w4);
  add(w8, piece_.w8);
  add(scaled, piece_.scaled);
  add(thickness, piece_.thickness);
  add(hn::Mul(thickness, middle), piece_.distance);
  add(hn::Mul(thickness, depth_in_middle), piece_.depth);
  add(scattered, piece_.albedo);
  add(hn::Mul(thickness, seen.g), piece_.g);
  if (scene_.mixed_tints) {
    add(hn::Mul(scattered, seen.tint.x), piece_.tint[0]);
    add(hn::Mul(scattered, seen.tint.y), piece_.tint[1]);
    add(hn::Mul(scattered, seen.tint.z), piece_.tint[2]);
  }
  if (scene_.emits) {
    HWY_ALIGN Lane at, straight, peaked, before;
    const V inverse = hn::Div(set(1.0f), hn::Max(extinction, set(1e-37f)));
    put(middle, at);
    put(hn::IfThenElse(any, hn::Mul(w, inverse), hn::Mul(passed, length)), straight);
    put(hn::IfThenElse(any, hn::Mul(scaled, hn::Mul(inverse, set(1 / scene_.scaled_extinction))),
                       hn::Mul(passed_scaled, length)),
        peaked);
    put(depth_in_middle, before);
    for_each_lane(active, [&](size_t lane, size_t ray) {
      host_.emit(ray, at[lane], straight[lane], peaked[lane], before[lane]);
    });
  }
  put(hn::Sub(passed, w), passed_);
  put(hn::Sub(get(passed2_), w2), passed2_);
  put(hn::Sub(get(passed4_), w4), passed4_);
  const V passed8 = hn::Sub(get(passed8_), w8);
  put(passed8, passed8_);
  put(hn::Sub(passed_scaled, scaled), passed_scaled_);
  put(hn::Add(depth, thickness), depth_);

  // Distances from where anything was seen first keep what rounding would take from their squares' mean.
  const M met = hn::And(any, hn::Le(get(seen_), zero));
  const V first = hn::IfThenElse(met, middle, get(first_));
  put(first, first_);
  const V behind = hn::Mul(w, hn::Sub(middle, first));
  add(w, seen_);
  add(behind, distance_);
  add(hn::Mul(behind, hn::Sub(middle, first)), distance2_);
  add(hn::Mul(w, seen.density), density_);
  const V steepness = hn::Add(hn::Sqrt(dot(seen.gradient, seen.gradient)), set(scene_.gentle_gradient));
  const V share = hn::Div(w, steepness);
  add(hn::Mul(share, seen.gradient.x), gradient_[0]);
  add(hn::Mul(share, seen.gradient.y), gradient_[1]);
  add(hn::Mul(share, seen.gradient.z), gradient_[2]);

  put(hn::IfThenElse(active, next, t), t_);
  // Where steps are lost in rounding the part has ended, too.
  const M ended = hn::And(active, hn::Or(hn::Ge(next, end), hn::Le(next, t)));
  const M opaque = hn::And(active, hn::Le(passed8, set(kOpaque)));
  if (!hn::AllFalse(d, hn::Or(ended, opaque))) end_parts(ended, opaque);
}

void Marching::end_parts(M ended, M opaque) {
  uint32_t finished = bits_of(opaque);
  for_each_lane(hn::AndNot(opaque, ended), [&](size_t lane, size_t ray) {
    if (++part_[lane] == rays_[ray].last_part)
      finished |= 1u << lane;
    else
      begin_part(lane);
  });
  if (!finished) return;
  const M done = mask_of(finished);
  add_light(done);
  add_fields(done);
  for_each_lane(done, [&](size_t lane, size_t) { finish(lane); });
}

/// Adds the light that pieces scatter towards the eye: of suns and lamps at once, fields of nodes when the pieces since
/// they were looked up last are as long as nodes are apart.
void Marching::add_light(M mask) {
  const D d;
  const V zero = hn::Zero(d);
  mask = hn::And(mask, hn::Gt(get(piece_.thickness), zero));
  if (hn::AllFalse(d, mask)) return;
  for (size_t k = 0; k < scene_.suns.size(); ++k) add_sun(k, mask);
  if (scene_.other_lights) for_each_lane(mask, [&](size_t lane, size_t ray) { host_.light(ray, piece_.of(lane)); });
  const auto longer = [&](const Lane& end, float than) {
    return hn::And(mask, hn::Gt(hn::Sub(get(end), get(wide_.begin)), set(than)));
  };
  add_fields(longer(piece_.end, 2 * scene_.look_apart));
  wide_.join(piece_, mask, scene_.mixed_tints);
  add_fields(
      hn::Or(longer(wide_.end, scene_.look_apart), hn::And(mask, hn::Gt(get(wide_.thickness), set(kNodeThickness)))));
}

void Marching::add_fields(M mask) {
  mask = hn::And(mask, hn::Gt(get(wide_.thickness), hn::Zero(D())));
  if (hn::AllFalse(D(), mask)) return;
  if (scene_.fields.values)
    add_known_fields(mask);
  else
    for_each_lane(mask, [&](size_t lane, size_t ray) { host_.fields(ray, wide_.of(lane)); });
  wide_.clear(mask);
}

/// Where points lie between the nodes is found side by side, the fields of each point, too.
void Marching::add_known_fields(M mask) {
  const D d;
  const DI di;
  const MarchedFields& known = scene_.fields;
  const V zero = hn::Zero(d), one = set(1.0f);
  const V inverse = hn::Div(one, hn::Max(get(wide_.thickness), set(1e-37f)));
  const V3 p = nodes_.at(hn::Mul(get(wide_.distance), inverse));
  const V place[3] = {p.x, p.y, p.z};
  V f[3], e[3];
  VI node[3];
  for (int a = 0; a < 3; ++a) {
    const V c = hn::Min(hn::Max(place[a], zero), set(static_cast<float>(known.n[a] - 1)));
    const V whole = hn::Min(hn::Floor(c), set(static_cast<float>(known.n[a] - 2)));
    node[a] = hn::ConvertTo(di, whole);
    f[a] = hn::Sub(c, whole);
    e[a] = hn::Sub(one, f[a]);
  }
  HWY_ALIGN int32_t first[kMost];
  const VI row = hn::Add(hn::Mul(node[0], hn::Set(di, known.n[1])), node[1]);
  hn::Store(hn::Add(hn::Mul(row, hn::Set(di, known.n[2])), node[2]), di, first);
  HWY_ALIGN Lane weight[8], albedo;
  for (int corner = 0; corner < 8; ++corner) {
    const V xy = hn::Mul(corner & 4 ? f[0] : e[0], corner & 2 ? f[1] : e[1]);
    put(hn::Mul(xy, corner & 1 ? f[2] : e[2]), weight[corner]);
  }
  put(hn::Mul(get(wide_.albedo), inverse), albedo);

  const auto count = static_cast<size_t>(known.count);
  const size_t y = count * static_cast<size_t>(known.n[2]), x = y * static_cast<size_t>(known.n[1]);
  for_each_lane(mask, [&](size_t lane, size_t ray) {
    const MarchedRay& to = rays_[ray];
    const float* const base = known.values + static_cast<size_t>(first[lane]) * count;
    const V w = set(wide_.w[lane]), scaled = set(wide_.scaled[lane]);
    V corners[8];
    for (size_t c = 0; c < 8; ++c) corners[c] = set(weight[c][lane]);
    HWY_ALIGN float fields[MarchedFields::kMost];
    for (size_t m = 0; m < count; m += hn::Lanes(d)) {
      const float* const at = base + m;
      const auto corner = [&](size_t c, size_t offset) { return hn::Mul(corners[c], hn::LoadU(d, at + offset)); };
      V sum = hn::Add(corner(0, 0), corner(1, count));
      sum = hn::Add(sum, hn::Add(corner(2, y), corner(3, y + count)));
      sum = hn::Add(sum, hn::Add(corner(4, x), corner(5, x + count)));
      sum = hn::Add(sum, hn::Add(corner(6, x + y), corner(7, x + y + count)));
      hn::Store(sum, d, fields + m);
      hn::StoreU(hn::Add(hn::LoadU(d, to.plain + m), hn::Mul(w, sum)), d, to.plain + m);
      hn::StoreU(hn::Add(hn::LoadU(d, to.scaled + m), hn::Mul(scaled, sum)), d, to.scaled + m);
    }
    for (size_t g = 0; g < known.groups.size(); ++g) {
      const MarchedFields::Group& group = known.groups[g];
      MarchedRay::FieldSums& sums = to.groups[g];
      const float tail = fields[group.tail];
      sums.tail[0] += wide_.w2[lane] * tail;
      sums.tail[1] += wide_.w4[lane] * tail;
      sums.tail[2] += wide_.w8[lane] * tail;
      if (group.single < 0) continue;
      sums.single += wide_.w[lane] * albedo[lane] * fields[group.single];
      sums.forward += wide_.scaled[lane] * albedo[lane] * fields[group.forward];
    }
  });
}

HWY_INLINE void Marching::add_sun(size_t k, M mask) {
  const DI di;
  const V zero = hn::Zero(D());
  const MarchedSun& known = scene_.suns[k];
  Sun& sun = sun_[k];
  const V inverse = hn::Div(set(1.0f), hn::Max(get(piece_.thickness), set(1e-37f)));
  const V distance = hn::Mul(get(piece_.distance), inverse);

  // Optical depth towards it.
  const V3 p = sun.place.at(distance);
  V f[3];
  VI node[3];
  const V place[3] = {p.x, p.y, p.z};
  for (int a = 0; a < 3; ++a) {
    const V c = hn::Min(hn::Max(place[a], zero), set(static_cast<float>(known.n[a] - 1)));
    const V whole = hn::Min(hn::Floor(c), set(static_cast<float>(known.n[a] - 2)));
    node[a] = hn::ConvertTo(di, whole);
    f[a] = hn::Sub(c, whole);
  }
  const VI column = hn::Add(hn::Mul(node[1], hn::Set(di, known.n[2])), node[2]);
  const VI index =
      hn::IfThenElseZero(hn::RebindMask(di, mask), hn::Add(hn::Mul(column, hn::Set(di, known.n[0])), node[0]));
  const auto along = [&](int32_t offset) {
    const ShortPair roots = short_pair(known.roots + offset, index);
    const V a = hn::Mul(set(known.root_step), roots.first), b = hn::Mul(set(known.root_step), roots.second);
    return lerp(hn::Mul(a, a), hn::Mul(b, b), f[0]);
  };
  const int32_t next_v = known.n[0], next_u = known.n[0] * known.n[2];
  const V tau = lerp(lerp(along(0), along(next_v), f[2]), lerp(along(next_u), along(next_u + next_v), f[2]), f[1]);

  V irradiance = hn::Mul(set(known.irradiance), hn::Mul(get(piece_.albedo), inverse));
  if (known.shadowed) {
    HWY_ALIGN Lane at, visible = {};
    put(distance, at);
    for_each_lane(mask, [&](size_t lane, size_t ray) { visible[lane] = host_.sun_visible(ray, k, at[lane]); });
    irradiance = hn::Mul(irradiance, get(visible));
  }
  irradiance = hn::IfThenElseZero(mask, irradiance);

  const V v16 = exponential(hn::Mul(tau, set(-1.0f / 16))), v8 = hn::Mul(v16, v16), v4 = hn::Mul(v8, v8),
          v2 = hn::Mul(v4, v4), arriving = hn::Mul(v2, v2);
  const V lit = hn::Mul(get(piece_.w), irradiance);
  add(hn::Mul(lit, hn::Mul(get(sun.phase[0]), arriving)), sun.single);
  // ForwardPeak::repeated times what arrives: exponentials that would overflow are multiplied first.
  const V peak = hn::Min(hn::Mul(set(1 - scene_.scaled_extinction), hn::Add(tau, hn::Mul(get(piece_.depth), inverse))),
                         set(kDeepestPeak));
  V terms = get(sun.peak[6]);
  for (size_t i = 6; i-- > 0;) terms = hn::Add(get(sun.peak[i]), hn::Mul(peak, terms));
  const V rest = hn::Sub(exponential(hn::Sub(peak, tau)), arriving);
  const V turned = hn::Add(hn::Mul(arriving, hn::Mul(peak, terms)), hn::Mul(get(sun.peak[7]), rest));
  add(hn::Mul(lit, hn::Max(turned, zero)), sun.forward);
  add(hn::Mul(hn::Mul(get(piece_.w2), irradiance), hn::Mul(get(sun.phase[1]), v2)), sun.octave[0]);
  add(hn::Mul(hn::Mul(get(piece_.w4), irradiance), hn::Mul(get(sun.phase[2]), v4)), sun.octave[1]);
  add(hn::Mul(hn::Mul(get(piece_.w8), irradiance), hn::Mul(get(sun.phase[3]), v8)), sun.octave[2]);
  const V even = hn::Mul(lit, set(0.25f * std::numbers::inv_pi_v<float>));
  const V softened[4] = {v2, v4, v8, v16};
  for (size_t i = 0; i < 4; ++i) add(hn::Mul(even, softened[i]), sun.soft[i]);
}

void MarchRays(const MarchScene& scene, std::span<MarchedRay> rays, std::span<const float> parts, RayMarchHost& host) {
  Marching(scene, rays, parts, host).run();
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(MarchRays);

void march_rays(const MarchScene& scene, std::span<MarchedRay> rays, std::span<const float> parts, RayMarchHost& host) {
  HWY_DYNAMIC_DISPATCH(MarchRays)(scene, rays, parts, host);
}

}  // namespace brume
#endif
