#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/wavefront.cpp"
#include "render/wavefront.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "render/path_layers.h"
#include "volume/lane_grid.h"

// Shared by all instruction sets: what the kernels read and write.
#ifndef BRUME_RENDER_WAVEFRONT_TYPES
#define BRUME_RENDER_WAVEFRONT_TYPES
namespace brume {

constexpr size_t kPool = 2048;   // paths in flight per thread: their state stays in the second-level cache
constexpr size_t kPadding = 64;  // lists may be read past their end, up to a vector: into slots that nobody owns
constexpr size_t kMostSuns = 16;

/// The scene as the kernels need it, in single precision.
struct LaneScene {
  const float* majorant;
  const int32_t* brick;
  const float* values;
  float nx, ny, nz;
  int32_t nz_int;
  float sigma;  // extinction per density
  float local_from_world[3][3];
  float g;
  float albedo[3];
  int roulette_start;
  int max_events;
  bool interpolate;

  struct LaneSun {
    float x[3], y[3], z[3];  // a frame around its axis, world space
    float one_minus_cos, pdf, share_end, share;
    float radiance[3];
    bool delta;
  };
  LaneSun suns[kMostSuns];
  size_t sun_count = 0;
  /// Sampled by the remaining share of the choice; null where none is.
  const Environment* environment = nullptr;
  float environment_share = 0;
};

/// State of the paths of one thread, one array per member.
struct LanePool {
  template <class T>
  using Column = std::array<T, kPool + kPadding>;
  Column<float> ox, oy, oz;  // position: local coordinates of the bricks
  Column<float> dx, dy, dz;  // direction: world, unit
  Column<float> lx, ly, lz;  // the same in local coordinates
  Column<float> sx, sy, sz;  // direction of the shadow ray, local
  Column<float> tr, tg, tb;  // throughput
  Column<float> cr, cg, cb;  // what the shadow ray brings if nothing dims it
  Column<float> pdf;         // of the last direction
  Column<float> transmittance;
  Column<float> direct_r, direct_g, direct_b, indirect_r, indirect_g, indirect_b;
  Column<uint32_t> s0, s1, s2, s3;  // generator: xoshiro128++
  Column<uint32_t> events;
  Column<uint32_t> request;  // which of the batch
};

/// A list of slots, padded so that whole vectors can be read.
struct SlotList {
  std::array<int32_t, kPool + kPadding> slot;
  size_t count = 0;
  void pad() {
    std::fill(slot.begin() + static_cast<std::ptrdiff_t>(count),
              slot.begin() + static_cast<std::ptrdiff_t>(count + kPadding), static_cast<int32_t>(kPool));
  }
  void push(int32_t s) { slot[count++] = s; }
};

}  // namespace brume
#endif

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<D>;
using DU = hn::RebindToUnsigned<D>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;
using M = hn::Mask<D>;

// No fused multiply-add anywhere: with it, instruction sets would differ in the last bit.

HWY_INLINE V set(float x) {
  return hn::Set(D(), x);
}

/// The generator of each lane. Source: Blackman, Vigna 2021, Scrambled Linear Pseudorandom Number Generators.
struct Generator {
  VU s0, s1, s2, s3;

  /// Advances the lanes of `mask`; the others keep their state (and get a number that means nothing).
  HWY_INLINE VU next(M mask) {
    const auto rotl = [](VU v, auto k) {
      constexpr int kBits = decltype(k)::value;
      return hn::Or(hn::ShiftLeft<kBits>(v), hn::ShiftRight<32 - kBits>(v));
    };
    const VU result = hn::Add(rotl(hn::Add(s0, s3), std::integral_constant<int, 7>()), s0);
    const VU t = hn::ShiftLeft<9>(s1);
    VU n2 = hn::Xor(s2, s0), n3 = hn::Xor(s3, s1);
    const VU n1 = hn::Xor(s1, n2), n0 = hn::Xor(s0, n3);
    n2 = hn::Xor(n2, t);
    n3 = rotl(n3, std::integral_constant<int, 11>());
    const auto m = hn::RebindMask(DU(), mask);
    s0 = hn::IfThenElse(m, n0, s0), s1 = hn::IfThenElse(m, n1, s1);
    s2 = hn::IfThenElse(m, n2, s2), s3 = hn::IfThenElse(m, n3, s3);
    return result;
  }
  /// In [0, 1), 24 bits.
  HWY_INLINE V uniform(M mask) {
    return hn::Mul(hn::ConvertTo(D(), hn::BitCast(DI(), hn::ShiftRight<8>(next(mask)))), set(0x1p-24f));
  }
  /// Unit exponential, up to 22.9.
  HWY_INLINE V exponential(M mask);
};

/// Natural logarithm of a positive normal number, relative error below 3e-7.
HWY_INLINE V log_of(V x) {
  const DI di;
  const VI bits = hn::BitCast(di, x);
  const VI shifted = hn::Sub(bits, hn::Set(di, 0x3f3504f3));  // e such that m = x / 2^e lies in [sqrt(1/2), sqrt(2))
  const VI e = hn::ShiftRight<23>(shifted);
  const V m = hn::BitCast(D(), hn::Sub(bits, hn::ShiftLeft<23>(e)));
  const V f = hn::Sub(m, set(1.0f)), s = hn::Div(f, hn::Add(m, set(1.0f))), z = hn::Mul(s, s);
  V p = hn::Add(hn::Mul(z, set(2.0f / 9)), set(2.0f / 7));
  p = hn::Add(hn::Mul(p, z), set(2.0f / 5));
  p = hn::Add(hn::Mul(p, z), set(2.0f / 3));
  p = hn::Add(hn::Mul(p, z), set(2.0f));
  return hn::Add(hn::Mul(hn::ConvertTo(D(), e), set(std::numbers::ln2_v<float>)), hn::Mul(s, p));
}

HWY_INLINE V Generator::exponential(M mask) {
  const VU bits = next(mask);
  // All 32 bits: small numbers keep their precision, so that the tail of optical depths is reached.
  const DI di;
  const V high = hn::ConvertTo(D(), hn::BitCast(di, hn::ShiftRight<16>(bits)));
  const V low = hn::ConvertTo(D(), hn::BitCast(di, hn::And(bits, hn::Set(DU(), 0xffffu))));
  const V u = hn::Mul(hn::Max(hn::Add(hn::Mul(high, set(65536.0f)), low), set(0.5f)), set(0x1p-32f));
  return hn::Neg(log_of(u));
}

struct SinCosV {
  V sin, cos;
};

/// sin and cos of 2 pi u for u in [0, 1), absolute error below 4e-7.
HWY_INLINE SinCosV sincos_2pi(V u) {
  const V q = hn::Floor(hn::Add(hn::Mul(u, set(4.0f)), set(0.5f)));
  const V a = hn::Mul(hn::Sub(u, hn::Mul(q, set(0.25f))), set(6.28318531f)), z = hn::Mul(a, a);
  V s = hn::Sub(set(1.0f / 120), hn::Mul(z, set(1.0f / 5040)));
  s = hn::Sub(set(1.0f / 6), hn::Mul(z, s));
  s = hn::Mul(a, hn::Sub(set(1.0f), hn::Mul(z, s)));
  V c = hn::Sub(set(1.0f / 720), hn::Mul(z, set(1.0f / 40320)));
  c = hn::Sub(set(1.0f / 24), hn::Mul(z, c));
  c = hn::Sub(set(0.5f), hn::Mul(z, c));
  c = hn::Sub(set(1.0f), hn::Mul(z, c));
  const VI quadrant = hn::ConvertTo(DI(), q);
  const DI di;
  const auto odd = hn::RebindMask(D(), hn::Ne(hn::And(quadrant, hn::Set(di, 1)), hn::Zero(di)));
  const auto minus_s = hn::RebindMask(D(), hn::Ne(hn::And(quadrant, hn::Set(di, 2)), hn::Zero(di)));
  const auto minus_c =
      hn::RebindMask(D(), hn::Ne(hn::And(hn::Add(quadrant, hn::Set(di, 1)), hn::Set(di, 2)), hn::Zero(di)));
  const V rs = hn::IfThenElse(odd, c, s), rc = hn::IfThenElse(odd, s, c);
  return {hn::IfThenElse(minus_s, hn::Neg(rs), rs), hn::IfThenElse(minus_c, hn::Neg(rc), rc)};
}

struct V3 {
  V x, y, z;
};
HWY_INLINE V dot(const V3& a, const V3& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE V3 transform(const float (&m)[3][3], const V3& v) {
  const auto row = [&](int r) {
    return hn::Add(hn::Add(hn::Mul(set(m[r][0]), v.x), hn::Mul(set(m[r][1]), v.y)), hn::Mul(set(m[r][2]), v.z));
  };
  return {row(0), row(1), row(2)};
}

/// Henyey-Greenstein without cancellation: see volume/phase_function.h.
HWY_INLINE V phase_value(float g, V cos_theta) {
  const float a = std::abs(g), one_minus = 1.0f - a;
  const V c = g < 0 ? hn::Neg(cos_theta) : cos_theta;
  const V d = hn::Add(set(one_minus * one_minus), hn::Mul(set(2.0f * a), hn::Sub(set(1.0f), c)));
  return hn::Div(set((1.0f - g * g) * 0.0795774715f), hn::Mul(d, hn::Sqrt(d)));
}
HWY_INLINE V phase_cosine(float g, V xi) {
  const V s = hn::Sub(hn::Add(xi, xi), set(1.0f));
  const V d = hn::Add(set(1.0f), hn::Mul(set(g), s));
  V c;
  if (std::abs(g) < 0.5f) {
    const V s2 = hn::Mul(s, s);
    V n = hn::Add(s, hn::Mul(set(g), hn::Add(set(1.5f), hn::Mul(set(0.5f), s2))));
    n = hn::Add(n, hn::Mul(set(g * g), s));
    n = hn::Add(n, hn::Mul(set(0.5f * g * g * g), hn::Sub(s2, set(1.0f))));
    c = hn::Div(n, hn::Mul(d, d));
  } else {
    const V t = hn::Div(set(1.0f - g * g), d);
    c = hn::Mul(hn::Sub(set(1.0f + g * g), hn::Mul(t, t)), set(0.5f / g));
  }
  return hn::Min(hn::Max(c, set(-1.0f)), set(1.0f));
}

/// Turns local (x, y, z) into the frame around the unit vector n, and makes it a unit vector again.
HWY_INLINE V3 around(const V3& n, V x, V y, V z) {
  const V sign = hn::CopySign(set(1.0f), n.z);
  const V a = hn::Neg(hn::Div(set(1.0f), hn::Add(sign, n.z))), b = hn::Mul(hn::Mul(n.x, n.y), a);
  const V3 u{hn::Add(set(1.0f), hn::Mul(hn::Mul(sign, hn::Mul(n.x, n.x)), a)), hn::Mul(sign, b),
             hn::Neg(hn::Mul(sign, n.x))};
  const V3 v{b, hn::Add(sign, hn::Mul(hn::Mul(n.y, n.y), a)), hn::Neg(n.y)};
  V3 r{hn::Add(hn::Add(hn::Mul(u.x, x), hn::Mul(v.x, y)), hn::Mul(n.x, z)),
       hn::Add(hn::Add(hn::Mul(u.y, x), hn::Mul(v.y, y)), hn::Mul(n.y, z)),
       hn::Add(hn::Add(hn::Mul(u.z, x), hn::Mul(v.z, y)), hn::Mul(n.z, z))};
  const V scale = hn::Div(set(1.0f), hn::Sqrt(dot(r, r)));
  return {hn::Mul(r.x, scale), hn::Mul(r.y, scale), hn::Mul(r.z, scale)};
}

HWY_INLINE uint32_t bits_of(M mask) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(D(), mask, bytes);
  uint32_t bits;
  std::memcpy(&bits, bytes, sizeof bits);
  return bits;
}
HWY_INLINE M mask_of(uint32_t bits) {
  uint8_t bytes[8] = {};
  std::memcpy(bytes, &bits, sizeof bits);
  return hn::LoadMaskBits(D(), bytes);
}

struct TrackCounters {
  uint64_t lookups = 0;
};

enum class Walk { kFlight, kShadow, kSurface };

/// The interpolated density at points of cells, q relative to the cell in [0, 8].
HWY_INLINE V interpolated(const LaneScene& scene, VI brick, V qx, V qy, V qz) {
  const DI di;
  const V highest = set(7.0f);
  const V x0 = hn::Min(hn::Floor(qx), highest), y0 = hn::Min(hn::Floor(qy), highest),
          z0 = hn::Min(hn::Floor(qz), highest);
  const V fx = hn::Sub(qx, x0), fy = hn::Sub(qy, y0), fz = hn::Sub(qz, z0);
  const VI nine = hn::Set(di, 9);
  VI index = hn::Add(hn::Mul(hn::Add(hn::Mul(hn::ConvertTo(di, x0), nine), hn::ConvertTo(di, y0)), nine),
                     hn::ConvertTo(di, z0));
  index = hn::Add(index, brick);
  const auto value = [&](int offset) { return hn::GatherIndex(D(), scene.values + offset, index); };
  const auto lerp = [](V a, V b, V f) { return hn::Add(a, hn::Mul(f, hn::Sub(b, a))); };
  const V a = lerp(lerp(value(0), value(1), fz), lerp(value(9), value(10), fz), fy);
  const V b = lerp(lerp(value(81), value(82), fz), lerp(value(90), value(91), fz), fy);
  return lerp(a, b, fx);
}

/// Walks the rays of a list through the majorant cells. Flights end at a real collision, whose position becomes the
/// path's, or leave the grid; shadow rays gather their transmittance by ratio tracking; the walk to the medium's
/// surface ends, voxel by voxel, where the density reaches `iso`, and leaves the ray parameter or -1 in
/// `transmittance`.
template <Walk kWalk>
HWY_INLINE void track(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList* hits, SlotList* escapes,
                      float iso, TrackCounters& counters) {
  constexpr bool kShadow = kWalk == Walk::kShadow, kSurface = kWalk == Walk::kSurface;
  const D d;
  const DI di;
  const DU du;
  constexpr size_t kMost = hn::MaxLanes(d);
  const size_t lanes = hn::Lanes(d);
  const uint32_t all = lanes >= 32 ? ~0u : (1u << lanes) - 1;
  // New rays are loaded when this many lanes are free, or none is busy: loading costs as much for one as for all.
  const size_t worth_loading = std::max<size_t>(1, lanes / 4);

  HWY_ALIGN int32_t slot[kMost] = {};
  HWY_ALIGN float ax[kMost] = {}, ay[kMost] = {}, az[kMost] = {}, bx[kMost] = {}, by[kMost] = {}, bz[kMost] = {};
  HWY_ALIGN float result_x[kMost], result_y[kMost], result_z[kMost];
  HWY_ALIGN uint32_t r0[kMost] = {}, r1[kMost] = {}, r2[kMost] = {}, r3[kMost] = {};

  const V zero = hn::Zero(d), one = set(1.0f), eight = set(8.0f), huge = set(1e30f), tiny = set(1e-12f);
  V ox = zero, oy = zero, oz = zero, dx = one, dy = one, dz = one, ix = one, iy = one, iz = one;
  V t = zero, cx = zero, cy = zero, cz = zero, tau = zero, weight = one;
  V px = zero, py = zero, pz = zero, voxel_step = one;
  Generator rng{hn::Zero(du), hn::Zero(du), hn::Zero(du), hn::Zero(du)};
  uint32_t busy = 0, finished = 0, collided = 0;
  size_t next = 0;

  for (;;) {
    const auto free_lanes = static_cast<size_t>(std::popcount(all & ~busy));
    if (busy == 0 || (next < rays.count && free_lanes >= worth_loading)) {
      if (finished) {
        hn::Store(rng.s0, du, r0), hn::Store(rng.s1, du, r1), hn::Store(rng.s2, du, r2), hn::Store(rng.s3, du, r3);
        if (kShadow) {
          hn::Store(weight, d, result_x);
        } else if (kSurface) {
          hn::Store(t, d, result_x);
        } else {
          hn::Store(px, d, result_x), hn::Store(py, d, result_y), hn::Store(pz, d, result_z);
        }
        for (uint32_t left = finished; left; left &= left - 1) {
          const auto lane = static_cast<size_t>(std::countr_zero(left));
          const auto s = static_cast<size_t>(slot[lane]);
          pool.s0[s] = r0[lane], pool.s1[s] = r1[lane], pool.s2[s] = r2[lane], pool.s3[s] = r3[lane];
          if (kShadow) {
            pool.transmittance[s] = result_x[lane];
          } else if (kSurface) {
            pool.transmittance[s] = collided >> lane & 1 ? result_x[lane] : -1.0f;
          } else if (collided >> lane & 1) {
            pool.ox[s] = result_x[lane], pool.oy[s] = result_y[lane], pool.oz[s] = result_z[lane];
            hits->push(slot[lane]);
          } else {
            escapes->push(slot[lane]);
          }
        }
        finished = 0;
      }
      if (next == rays.count) {
        if (busy == 0) break;
      } else {
        hn::Store(ox, d, ax), hn::Store(oy, d, ay), hn::Store(oz, d, az);
        hn::Store(dx, d, bx), hn::Store(dy, d, by), hn::Store(dz, d, bz);
        hn::Store(rng.s0, du, r0), hn::Store(rng.s1, du, r1), hn::Store(rng.s2, du, r2), hn::Store(rng.s3, du, r3);
        uint32_t loaded = 0;
        for (uint32_t left = all & ~busy; left && next < rays.count; left &= left - 1) {
          const auto lane = static_cast<size_t>(std::countr_zero(left));
          const auto s = static_cast<size_t>(slot[lane] = rays.slot[next++]);
          ax[lane] = pool.ox[s], ay[lane] = pool.oy[s], az[lane] = pool.oz[s];
          bx[lane] = (kShadow ? pool.sx : pool.lx)[s], by[lane] = (kShadow ? pool.sy : pool.ly)[s];
          bz[lane] = (kShadow ? pool.sz : pool.lz)[s];
          r0[lane] = pool.s0[s], r1[lane] = pool.s1[s], r2[lane] = pool.s2[s], r3[lane] = pool.s3[s];
          loaded |= 1u << lane;
        }
        ox = hn::Load(d, ax), oy = hn::Load(d, ay), oz = hn::Load(d, az);
        dx = hn::Load(d, bx), dy = hn::Load(d, by), dz = hn::Load(d, bz);
        rng = {hn::Load(du, r0), hn::Load(du, r1), hn::Load(du, r2), hn::Load(du, r3)};
        const M fresh = mask_of(loaded);
        // A direction across an axis never reaches its planes.
        const auto inverse = [&](V v) {
          return hn::IfThenElse(hn::Lt(hn::Abs(v), tiny), hn::CopySign(huge, v), hn::Div(one, v));
        };
        ix = inverse(dx), iy = inverse(dy), iz = inverse(dz);
        const auto cell = [&](V o, float n) {
          return hn::Min(hn::Max(hn::Floor(hn::Mul(o, set(0.125f))), zero), set(n - 1));
        };
        cx = hn::IfThenElse(fresh, cell(ox, scene.nx), cx);
        cy = hn::IfThenElse(fresh, cell(oy, scene.ny), cy);
        cz = hn::IfThenElse(fresh, cell(oz, scene.nz), cz);
        t = hn::IfThenElse(fresh, zero, t);
        weight = hn::IfThenElse(fresh, kSurface ? zero : one, weight);
        if (kSurface)
          voxel_step = hn::Div(one, hn::Sqrt(dot({dx, dy, dz}, {dx, dy, dz})));
        else
          tau = hn::IfThenElse(fresh, rng.exponential(fresh), tau);
        busy |= loaded;
      }
    }
    const M active = mask_of(busy);

    // The cell: its bound, or how far around it is empty.
    const V row = hn::Add(hn::Mul(cx, set(scene.ny)), cy);
    VI cell_index = hn::Add(hn::Mul(hn::ConvertTo(di, row), hn::Set(di, scene.nz_int)), hn::ConvertTo(di, cz));
    cell_index = hn::IfThenElseZero(hn::RebindMask(di, active), cell_index);
    const V bound = hn::GatherIndex(d, scene.majorant, cell_index);
    const M empty = hn::Lt(bound, zero);
    const V ahead = hn::IfThenElse(empty, hn::Neg(bound), one);  // cells to the far faces
    const V behind = hn::Sub(one, ahead);                        // and to the near ones
    const M right_x = hn::Ge(dx, zero), right_y = hn::Ge(dy, zero), right_z = hn::Ge(dz, zero);
    const auto exit_time = [&](V c, M right, V o, V inverse) {
      const V plane = hn::Mul(hn::Add(c, hn::IfThenElse(right, ahead, behind)), eight);
      return hn::Mul(hn::Sub(plane, o), inverse);
    };
    const V tx = exit_time(cx, right_x, ox, ix), ty = exit_time(cy, right_y, oy, iy),
            tz = exit_time(cz, right_z, oz, iz);
    const V exit = hn::Min(hn::Min(tx, ty), tz);
    const V until = hn::Max(exit, t);
    const V sigma_maj = hn::Mul(bound, set(scene.sigma));
    const V remaining = hn::IfThenElse(empty, zero, hn::Mul(hn::Sub(until, t), sigma_maj));
    const M passes = hn::And(
        active, kSurface ? hn::Or(hn::Lt(bound, set(iso)), hn::Ge(t, until)) : hn::Or(empty, hn::Ge(tau, remaining)));
    const M collides = hn::AndNot(passes, active);

    // Lanes that cross into another cell. Equal times: the lowest axis first.
    {
      if (!kSurface) tau = hn::IfThenElse(passes, hn::Sub(tau, remaining), tau);
      const M first_x = hn::Eq(exit, tx), first_y = hn::AndNot(first_x, hn::Eq(exit, ty));
      const M first_z = hn::Not(hn::Or(first_x, first_y));
      const auto crossed = [&](V c, M first, M right, V o, V dir) {
        const V beyond = hn::Add(c, hn::IfThenElse(right, ahead, hn::Neg(ahead)));
        // On the other axes the cell can change only where several are crossed at once.
        const V at = hn::Floor(hn::Mul(hn::Add(o, hn::Mul(dir, until)), set(0.125f)));
        const V within = hn::Min(hn::Max(at, hn::Add(c, behind)), hn::Sub(hn::Add(c, ahead), one));
        return hn::IfThenElse(first, beyond, within);
      };
      const V nx = crossed(cx, first_x, right_x, ox, dx), ny = crossed(cy, first_y, right_y, oy, dy);
      const V nz = crossed(cz, first_z, right_z, oz, dz);
      cx = hn::IfThenElse(passes, nx, cx), cy = hn::IfThenElse(passes, ny, cy), cz = hn::IfThenElse(passes, nz, cz);
      t = hn::IfThenElse(passes, until, t);
    }
    const M left_x = hn::Or(hn::Lt(cx, zero), hn::Ge(cx, set(scene.nx)));
    const M left_y = hn::Or(hn::Lt(cy, zero), hn::Ge(cy, set(scene.ny)));
    const M left_z = hn::Or(hn::Lt(cz, zero), hn::Ge(cz, set(scene.nz)));
    M done = hn::And(passes, hn::Or(left_x, hn::Or(left_y, left_z)));

    if constexpr (kSurface) {
      // The density a voxel on; where it has reached the surface's, in between by a straight line.
      const V t1 = hn::Min(hn::Add(t, voxel_step), until);
      const auto within = [&](V o, V dir, V c) {
        const V q = hn::Sub(hn::Add(o, hn::Mul(dir, t1)), hn::Mul(c, eight));
        return hn::IfThenElseZero(collides, hn::Min(hn::Max(q, zero), eight));
      };
      const VI brick = hn::GatherIndex(di, scene.brick, hn::IfThenElseZero(hn::RebindMask(di, collides), cell_index));
      const V value = interpolated(scene, brick, within(ox, dx, cx), within(oy, dy, cy), within(oz, dz, cz));
      const M hit = hn::And(collides, hn::Ge(value, set(iso)));
      const V before = hn::Min(weight, set(iso));
      const V share = hn::Div(hn::Sub(set(iso), before), hn::Max(hn::Sub(value, before), set(1e-30f)));
      const V crossing = hn::Add(t, hn::Mul(hn::Sub(t1, t), hn::Min(share, one)));
      t = hn::IfThenElse(collides, hn::IfThenElse(hit, crossing, t1), t);
      weight = hn::IfThenElse(collides, value, hn::IfThenElse(passes, zero, weight));
      done = hn::Or(done, hit);
      collided |= bits_of(hit);
      const uint32_t reached = bits_of(done);
      collided &= ~(reached & ~bits_of(hit));
      busy &= ~reached;
      finished |= reached;
      continue;
    }
    // Lanes with a tentative collision: one voxel of the eight around the point, by its trilinear weight.
    if (!hn::AllFalse(d, collides)) {
      t = hn::IfThenElse(collides, hn::Add(t, hn::Div(tau, sigma_maj)), t);
      const V qx = hn::Add(ox, hn::Mul(dx, t)), qy = hn::Add(oy, hn::Mul(dy, t)), qz = hn::Add(oz, hn::Mul(dz, t));
      const VU jitter = rng.next(collides), jitter_z = rng.next(collides);
      const auto voxel = [&](V q, V c, VU bits) {  // bits: 16
        const V u = hn::Mul(hn::Add(hn::ConvertTo(d, hn::BitCast(di, bits)), set(0.5f)), set(0x1p-16f));
        const V within = hn::Min(hn::Max(hn::Sub(q, hn::Mul(c, eight)), zero), set(7.9999995f));
        return hn::ConvertTo(di, hn::Add(within, u));
      };
      const VU low = hn::Set(du, 0xffffu);
      const VI vx = voxel(qx, cx, hn::And(jitter, low)), vy = voxel(qy, cy, hn::ShiftRight<16>(jitter));
      const VI vz = voxel(qz, cz, hn::ShiftRight<16>(jitter_z));
      const VI brick = hn::GatherIndex(di, scene.brick, hn::IfThenElseZero(hn::RebindMask(di, collides), cell_index));
      V value;
      if (scene.interpolate) {
        const auto within = [&](V q, V c) {
          return hn::IfThenElseZero(collides, hn::Min(hn::Max(hn::Sub(q, hn::Mul(c, eight)), zero), eight));
        };
        value = interpolated(scene, brick, within(qx, cx), within(qy, cy), within(qz, cz));
      } else {
        const VI nine = hn::Set(di, 9);
        const VI index = hn::Add(hn::Add(hn::Mul(hn::Add(hn::Mul(vx, nine), vy), nine), vz), brick);
        value = hn::GatherIndex(d, scene.values, hn::IfThenElseZero(hn::RebindMask(di, collides), index));
      }
      counters.lookups += hn::CountTrue(d, collides);
      const V u = rng.uniform(collides);
      if (kShadow) {
        weight = hn::IfThenElse(collides, hn::Sub(weight, hn::Mul(weight, hn::Div(value, bound))), weight);
        // Roulette below 0.05: survivors go on with 0.1.
        const M small = hn::And(collides, hn::Lt(weight, set(0.05f)));
        const M survives = hn::Lt(hn::Mul(u, set(0.1f)), weight);
        weight = hn::IfThenElse(small, hn::IfThenElseZero(survives, set(0.1f)), weight);
        done = hn::Or(done, hn::AndNot(survives, small));
      } else {
        const M hit = hn::And(collides, hn::Lt(hn::Mul(u, bound), value));
        px = hn::IfThenElse(hit, qx, px), py = hn::IfThenElse(hit, qy, py), pz = hn::IfThenElse(hit, qz, pz);
        done = hn::Or(done, hit);
        const uint32_t bits = bits_of(hit);
        collided |= bits;
      }
      tau = hn::IfThenElse(collides, rng.exponential(collides), tau);
    }
    const uint32_t ended = bits_of(done);
    if (!kShadow) collided &= ~(ended & ~bits_of(hn::And(done, collides)));
    busy &= ~ended;
    finished |= ended;
  }
}

void Flight(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList& hits, SlotList& escapes,
            uint64_t& lookups) {
  TrackCounters counters;
  track<Walk::kFlight>(scene, pool, rays, &hits, &escapes, 0, counters);
  lookups += counters.lookups;
}

void Shadow(const LaneScene& scene, LanePool& pool, const SlotList& rays, uint64_t& lookups) {
  TrackCounters counters;
  track<Walk::kShadow>(scene, pool, rays, nullptr, nullptr, 0, counters);
  lookups += counters.lookups;
}

void Surface(const LaneScene& scene, LanePool& pool, const SlotList& rays, float iso) {
  TrackCounters counters;
  track<Walk::kSurface>(scene, pool, rays, nullptr, nullptr, iso, counters);
}

/// The event at the end of a flight: absorption, a sample of one light, roulette, a new direction.
/// @param shadows  those whose light sample is worth a shadow ray   @param alive  those that go on
void Scatter(const LaneScene& scene, LanePool& pool, SlotList& slots, SlotList& shadows, SlotList& alive,
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

    Generator rng{get_u(pool.s0), get_u(pool.s1), get_u(pool.s2), get_u(pool.s3)};
    const V3 dir{get(pool.dx), get(pool.dy), get(pool.dz)};
    V tr = hn::Mul(get(pool.tr), set(scene.albedo[0])), tg = hn::Mul(get(pool.tg), set(scene.albedo[1]));
    V tb = hn::Mul(get(pool.tb), set(scene.albedo[2]));

    if (scene.sun_count + (scene.environment != nullptr) > 0) {
      V choice = zero;
      if (scene.sun_count + (scene.environment != nullptr) > 1) choice = rng.uniform(everyone);
      const V u1 = rng.uniform(everyone), u2 = rng.uniform(everyone);
      V3 wi{zero, zero, one};
      V lr = zero, lg = zero, lb = zero, pdf_light = zero;
      M chosen_before = hn::FirstN(d, 0), is_delta = chosen_before;
      const SinCosV phi = sincos_2pi(u2);
      for (size_t k = 0; k < scene.sun_count; ++k) {
        const LaneScene::LaneSun& sun = scene.suns[k];
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
        lr = hn::IfThenElse(mine, set(sun.radiance[0]), lr), lg = hn::IfThenElse(mine, set(sun.radiance[1]), lg);
        lb = hn::IfThenElse(mine, set(sun.radiance[2]), lb);
        pdf_light = hn::IfThenElse(mine, set(sun.pdf * sun.share), pdf_light);
        if (sun.delta) is_delta = hn::Or(is_delta, mine);
      }
      if (scene.environment) {
        HWY_ALIGN float f[9][hn::MaxLanes(d)];
        hn::Store(u1, d, f[0]), hn::Store(u2, d, f[1]);
        hn::Store(wi.x, d, f[2]), hn::Store(wi.y, d, f[3]), hn::Store(wi.z, d, f[4]);
        hn::Store(lr, d, f[5]), hn::Store(lg, d, f[6]), hn::Store(lb, d, f[7]), hn::Store(pdf_light, d, f[8]);
        for (uint32_t left = valid_bits & ~bits_of(chosen_before); left; left &= left - 1) {
          const auto lane = static_cast<size_t>(std::countr_zero(left));
          const LightSample sample = scene.environment->sample(dvec2(f[0][lane], f[1][lane]));
          f[2][lane] = static_cast<float>(sample.wi.x), f[3][lane] = static_cast<float>(sample.wi.y);
          f[4][lane] = static_cast<float>(sample.wi.z);
          f[5][lane] = static_cast<float>(sample.radiance.x), f[6][lane] = static_cast<float>(sample.radiance.y);
          f[7][lane] = static_cast<float>(sample.radiance.z);
          f[8][lane] = static_cast<float>(sample.pdf) * scene.environment_share;
        }
        wi = {hn::Load(d, f[2]), hn::Load(d, f[3]), hn::Load(d, f[4])};
        lr = hn::Load(d, f[5]), lg = hn::Load(d, f[6]), lb = hn::Load(d, f[7]), pdf_light = hn::Load(d, f[8]);
      }
      const V phase = phase_value(scene.g, dot(dir, wi));
      const V mis = hn::IfThenElse(is_delta, one, hn::Div(pdf_light, hn::Add(pdf_light, phase)));
      const V factor = hn::IfThenElseZero(hn::Gt(pdf_light, zero), hn::Div(hn::Mul(phase, mis), pdf_light));
      const V cr = hn::Mul(hn::Mul(tr, lr), factor), cg = hn::Mul(hn::Mul(tg, lg), factor);
      const V cb = hn::Mul(hn::Mul(tb, lb), factor);
      put(cr, pool.cr), put(cg, pool.cg), put(cb, pool.cb);
      const V3 local = transform(scene.local_from_world, wi);
      put(local.x, pool.sx), put(local.y, pool.sy), put(local.z, pool.sz);
      uint32_t worth = valid_bits & bits_of(hn::Gt(hn::Max(hn::Max(cr, cg), cb), zero));
      for (; worth; worth &= worth - 1) shadows.push(slots.slot[i + static_cast<size_t>(std::countr_zero(worth))]);
    }

    const VU events = hn::Add(get_u(pool.events), hn::Set(du, 1));
    put_u(events, pool.events);
    // Russian roulette by the largest channel, never below 0.05.
    const auto late = hn::RebindMask(d, hn::Gt(hn::BitCast(di, events), hn::Set(di, scene.roulette_start - 1)));
    const V largest = hn::Max(hn::Max(tr, tg), tb), survival = hn::Min(hn::Max(largest, set(0.05f)), one);
    const M plays = hn::And(everyone, hn::And(late, hn::Lt(survival, one)));
    M lives = everyone;
    if (!hn::AllFalse(d, plays)) {
      const V u = rng.uniform(plays);
      lives = hn::AndNot(hn::And(plays, hn::Ge(u, survival)), everyone);
      const V boost = hn::IfThenElse(plays, hn::Div(one, survival), one);
      tr = hn::Mul(tr, boost), tg = hn::Mul(tg, boost), tb = hn::Mul(tb, boost);
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

    const V cos_theta = phase_cosine(scene.g, rng.uniform(everyone));
    const V sin_theta = hn::Sqrt(hn::Max(hn::Mul(hn::Sub(one, cos_theta), hn::Add(one, cos_theta)), zero));
    const SinCosV phi = sincos_2pi(rng.uniform(everyone));
    const V3 turned = around(dir, hn::Mul(sin_theta, phi.cos), hn::Mul(sin_theta, phi.sin), cos_theta);
    put(phase_value(scene.g, dot(dir, turned)), pool.pdf);
    put(turned.x, pool.dx), put(turned.y, pool.dy), put(turned.z, pool.dz);
    const V3 local = transform(scene.local_from_world, turned);
    put(local.x, pool.lx), put(local.y, pool.ly), put(local.z, pool.lz);
    put(tr, pool.tr), put(tg, pool.tg), put(tb, pool.tb);
    put_u(rng.s0, pool.s0), put_u(rng.s1, pool.s1), put_u(rng.s2, pool.s2), put_u(rng.s3, pool.s3);
    for (uint32_t left = valid_bits & bits_of(lives); left; left &= left - 1)
      alive.push(slots.slot[i + static_cast<size_t>(std::countr_zero(left))]);
  }
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {
namespace {

HWY_EXPORT(Flight);
HWY_EXPORT(Shadow);
HWY_EXPORT(Surface);
HWY_EXPORT(Scatter);

LaneScene lane_scene(const PathContext& context) {
  const Medium& medium = context.media[0];
  const LaneGrid& grid = *context.lane_grid;
  LaneScene s{};
  s.majorant = grid.majorant.data();
  s.brick = grid.brick.data();
  s.values = grid.values;
  s.nx = static_cast<float>(grid.nx), s.ny = static_cast<float>(grid.ny), s.nz = static_cast<float>(grid.nz);
  s.nz_int = grid.nz;
  s.sigma = static_cast<float>(medium.extinction_per_density());
  const dmat3& m = medium.placement().local_from_world();
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) s.local_from_world[row][column] = static_cast<float>(m[column][row]);
  s.g = static_cast<float>(medium.phase().first.g);
  for (int c = 0; c < 3; ++c) s.albedo[c] = static_cast<float>(medium.albedo()[c]);
  s.roulette_start = context.roulette_start;
  s.max_events = context.max_events;
  s.interpolate = context.interpolate;
  if (!context.plan.light_sampling) return s;
  double end = 0;
  const dvec3 anywhere(0);
  for (const Sun* sun : context.lights->suns()) {
    const double share = context.lights->choice_probability(*sun, anywhere);
    if (!(share > 0)) continue;
    LaneScene::LaneSun& lane_sun = s.suns[s.sun_count++];
    const Frame frame(sun->axis());
    for (int a = 0; a < 3; ++a) {
      lane_sun.x[a] = static_cast<float>(frame.x[a]), lane_sun.y[a] = static_cast<float>(frame.y[a]);
      lane_sun.z[a] = static_cast<float>(frame.z[a]);
      lane_sun.radiance[a] = static_cast<float>(sun->delta() ? sun->irradiance()[a] : sun->disc_radiance()[a]);
    }
    lane_sun.delta = sun->delta();
    lane_sun.one_minus_cos = sun->delta() ? 0.0f : static_cast<float>(sun->one_minus_cos());
    lane_sun.pdf = sun->delta() ? 1.0f : static_cast<float>(1.0 / (2.0 * kPi * sun->one_minus_cos()));
    lane_sun.share = static_cast<float>(share);
    lane_sun.share_end = static_cast<float>(end += share);
  }
  const double share = context.lights->choice_probability(*context.lights->environment(), anywhere);
  if (share > 0) s.environment = context.lights->environment(), s.environment_share = static_cast<float>(share);
  return s;
}

/// One thread's paths on their way.
class Wavefront {
 public:
  Wavefront(const PathContext& context, std::span<const PathRequest> requests, std::span<PathSample> samples,
            PathCounters& counters)
      : c_(context), scene_(lane_scene(context)), requests_(requests), samples_(samples), counters_(counters) {
    static thread_local State state;
    state_ = &state;
  }

  void run() {
    State& s = *state_;
    s.active.count = 0;
    free_.resize(kPool);
    for (size_t i = 0; i < kPool; ++i) free_[i] = static_cast<int32_t>(kPool - 1 - i);
    TrackingCounters& tracking = counters_.tracking;
    std::fill(samples_.begin(), samples_.end(), PathSample{});
    if (c_.plan.medium_surface) record_surfaces();
    for (;;) {
      while (!free_.empty() && next_ < requests_.size()) start(next_++);
      if (s.active.count == 0) break;
      s.hits.count = s.escapes.count = s.shadows.count = s.alive.count = 0;
      HWY_DYNAMIC_DISPATCH(Flight)(scene_, s.pool, s.active, s.hits, s.escapes, tracking.lookups);
      for (size_t i = 0; i < s.escapes.count; ++i) escape(s.escapes.slot[i]);
      tracking.collisions += s.hits.count;
      for (size_t i = 0; i < s.hits.count; ++i)
        if (s.pool.events[static_cast<size_t>(s.hits.slot[i])] == 0) record_first(s.hits.slot[i]);
      HWY_DYNAMIC_DISPATCH(Scatter)
      (scene_, s.pool, s.hits, s.shadows, s.alive, counters_.capped_paths, counters_.capped_throughput);
      HWY_DYNAMIC_DISPATCH(Shadow)(scene_, s.pool, s.shadows, tracking.lookups);
      add_light();
      for (size_t i = 0; i < s.alive.count; ++i) alive_[static_cast<size_t>(s.alive.slot[i])] = true;
      for (size_t i = 0; i < s.hits.count; ++i) {
        const auto slot = static_cast<size_t>(s.hits.slot[i]);
        if (!alive_[slot]) finish(s.hits.slot[i]);
        alive_[slot] = false;
      }
      s.active = s.alive;
    }
  }

 private:
  struct State {
    LanePool pool{};
    SlotList active, hits, escapes, shadows, alive;
  };

  /// Puts a ray into a slot from where it enters the grid's box: near it, single precision is enough.
  /// @return  the ray parameter there; nothing where it misses
  std::optional<double> enter(int32_t slot, const Ray& world) {
    const Medium& medium = c_.media[0];
    const Ray local = medium.to_local(world);
    const auto [lo, hi] = medium.support();
    const auto [t0, t1] = Solid{Solid::Shape::kBox, lo, hi}.intersect(local);
    const double entry = std::max(t0, 0.0);
    if (!(t1 > entry)) return std::nullopt;
    const dvec3 o = local.at(entry);
    LanePool& p = state_->pool;
    const auto i = static_cast<size_t>(slot);
    p.ox[i] = static_cast<float>(o.x), p.oy[i] = static_cast<float>(o.y), p.oz[i] = static_cast<float>(o.z);
    p.lx[i] = static_cast<float>(local.d.x), p.ly[i] = static_cast<float>(local.d.y);
    p.lz[i] = static_cast<float>(local.d.z);
    return entry;
  }

  /// Where the camera rays meet the medium's surface, for coverage and gradient.
  void record_surfaces() {
    const Medium& medium = c_.media[0];
    const auto iso = static_cast<float>(c_.surface_density * medium.maximum_density());
    SlotList& rays = state_->active;
    std::array<std::pair<size_t, double>, kPool> which;  // request and entry of each slot
    for (size_t next = 0; next < requests_.size();) {
      for (rays.count = 0; next < requests_.size() && rays.count < kPool; ++next)
        if (const auto entry = enter(static_cast<int32_t>(rays.count), requests_[next].ray)) {
          which[rays.count] = {next, *entry};
          rays.push(static_cast<int32_t>(rays.count));
        }
      HWY_DYNAMIC_DISPATCH(Surface)(scene_, state_->pool, rays, iso);
      for (size_t k = 0; k < rays.count; ++k) {
        const float t = state_->pool.transmittance[k];
        if (t < 0) continue;
        const auto& [request, entry] = which[k];
        record_medium_surface(medium, medium.to_local(requests_[request].ray), entry + static_cast<double>(t),
                              samples_[request]);
      }
    }
    rays.count = 0;
  }

  void start(size_t index) {
    const PathRequest& request = requests_[index];
    PathSample& sample = samples_[index];
    ++counters_.paths;
    record_camera_ray(c_, c_.media, request.ray, sample);
    const std::optional<double> entry = enter(free_.back(), request.ray);
    if (!entry) {
      sample.transmittance = dvec3(1);
      escape_directly(request.ray.d, sample);
      return;
    }
    LanePool& p = state_->pool;
    const int32_t slot = free_.back();
    free_.pop_back();
    const auto i = static_cast<size_t>(slot);
    p.dx[i] = static_cast<float>(request.ray.d.x), p.dy[i] = static_cast<float>(request.ray.d.y);
    p.dz[i] = static_cast<float>(request.ray.d.z);
    p.tr[i] = p.tg[i] = p.tb[i] = 1.0f;
    p.direct_r[i] = p.direct_g[i] = p.direct_b[i] = p.indirect_r[i] = p.indirect_g[i] = p.indirect_b[i] = 0.0f;
    p.events[i] = 0;
    p.request[i] = static_cast<uint32_t>(index);
    const uint64_t seed = hash_combine(request.key.pixel_hash(), request.key.sample);
    const uint64_t a = mix64(seed), b = mix64(seed ^ 0xda3e39cb94b95bdbull) | 1u;  // never all zero
    p.s0[i] = static_cast<uint32_t>(a), p.s1[i] = static_cast<uint32_t>(a >> 32);
    p.s2[i] = static_cast<uint32_t>(b), p.s3[i] = static_cast<uint32_t>(b >> 32);
    state_->active.push(slot);
  }

  void escape_directly(const dvec3& d, PathSample& sample) {
    for (const InfiniteLight* light : c_.lights->infinite())
      if (light->visible()) sample.background += light->radiance(d);
    sample.direct = sample.beauty = sample.background;
    if (c_.plan.flash) sample.flash = sample.direct;
  }

  /// A path that has left the medium sees what is behind.
  void escape(int32_t slot) {
    LanePool& p = state_->pool;
    const auto i = static_cast<size_t>(slot);
    const uint32_t events = p.events[i];
    const PathRequest& request = requests_[p.request[i]];
    if (events == 0) {
      // The ray went straight through: its own direction, in full precision.
      PathSample& sample = samples_[p.request[i]];
      sample.transmittance = dvec3(1);
      escape_directly(request.ray.d, sample);
      free_.push_back(slot);
      return;
    }
    const dvec3 d = glm::normalize(dvec3(p.dx[i], p.dy[i], p.dz[i]));
    const double pdf = p.pdf[i];
    dvec3 L(0);
    for (const InfiniteLight* light : c_.lights->infinite()) {
      const dvec3 radiance = light->radiance(d);
      if (radiance == dvec3(0)) continue;
      const double share = c_.plan.light_sampling ? c_.lights->choice_probability(*light, dvec3(0)) : 0.0;
      L += radiance * (share > 0 ? pdf / (pdf + share * light->pdf(d)) : 1.0);
    }
    const bool direct = events < 2;
    (direct ? p.direct_r : p.indirect_r)[i] += p.tr[i] * static_cast<float>(L.x);
    (direct ? p.direct_g : p.indirect_g)[i] += p.tg[i] * static_cast<float>(L.y);
    (direct ? p.direct_b : p.indirect_b)[i] += p.tb[i] * static_cast<float>(L.z);
    finish(slot);
  }

  void record_first(int32_t slot) {
    const LanePool& p = state_->pool;
    const auto i = static_cast<size_t>(slot);
    const PathRequest& request = requests_[p.request[i]];
    PathSample& sample = samples_[p.request[i]];
    const Medium& medium = c_.media[0];
    const dvec3 at = medium.to_world(dvec3(p.ox[i], p.oy[i], p.oz[i]));
    if (c_.plan.first_event)
      sample.flash = record_first_scatter(c_, c_.media, medium, request.ray.o, at, request.ray.d, dvec3(1),
                                          medium.albedo(), sample);
  }

  /// What the shadow rays brought. Light scattered once is direct (TRANSPORT.md section 11).
  void add_light() {
    LanePool& p = state_->pool;
    for (size_t k = 0; k < state_->shadows.count; ++k) {
      const auto i = static_cast<size_t>(state_->shadows.slot[k]);
      const float T = p.transmittance[i];
      const bool direct = p.events[i] < 2;
      (direct ? p.direct_r : p.indirect_r)[i] += p.cr[i] * T;
      (direct ? p.direct_g : p.indirect_g)[i] += p.cg[i] * T;
      (direct ? p.direct_b : p.indirect_b)[i] += p.cb[i] * T;
    }
  }

  void finish(int32_t slot) {
    const LanePool& p = state_->pool;
    const auto i = static_cast<size_t>(slot);
    PathSample& s = samples_[p.request[i]];
    s.direct = s.single = {p.direct_r[i], p.direct_g[i], p.direct_b[i]};
    s.indirect = {p.indirect_r[i], p.indirect_g[i], p.indirect_b[i]};
    s.beauty = s.direct + s.indirect;
    if (c_.plan.flash) s.flash = s.direct + c_.flash.intensity * s.flash;
    counters_.longest = std::max<uint64_t>(counters_.longest, p.events[i]);
    free_.push_back(slot);
  }

  const PathContext& c_;
  LaneScene scene_;
  std::span<const PathRequest> requests_;
  std::span<PathSample> samples_;
  PathCounters& counters_;
  State* state_;
  size_t next_ = 0;
  std::vector<int32_t> free_;
  std::array<bool, kPool> alive_{};
};

}  // namespace

bool fits_lanes(const Plan& plan, std::span<const Medium> media, const Lights& lights) {
  if (plan.media != Plan::Media::kOneGrey || plan.moving_media || plan.emission || plan.surfaces || plan.finite_lights)
    return false;
  const Medium& m = media[0];
  return !m.solid() && !m.coloured() && !m.global_majorant() && m.phase().is_henyey_greenstein() &&
         LaneGrid::fits(m.bricks()) && lights.points().empty() && lights.suns().size() <= kMostSuns;
}

void trace_paths_in_lanes(const PathContext& context, std::span<const PathRequest> requests,
                          std::span<PathSample> samples, PathCounters& counters) {
  Wavefront(context, requests, samples, counters).run();
}

}  // namespace brume
#endif
