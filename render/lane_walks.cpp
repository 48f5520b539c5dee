#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/lane_walks.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>

#include "render/lanes.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/lane_math.h"

struct TrackCounters {
  uint64_t lookups = 0;
};

enum class Walk { kFlight, kFirst, kShadow, kSurface, kMarch };

/// The interpolated density at points of cells, q relative to the cell in [0, cell].
HWY_INLINE V interpolated(const LaneScene& scene, VI brick, V qx, V qy, V qz) {
  const DI di;
  const V highest = set(scene.cell - 1.0f);
  const V x0 = hn::Min(hn::Floor(qx), highest), y0 = hn::Min(hn::Floor(qy), highest),
          z0 = hn::Min(hn::Floor(qz), highest);
  const V fx = hn::Sub(qx, x0), fy = hn::Sub(qy, y0), fz = hn::Sub(qz, z0);
  const VI stored = hn::Set(di, scene.stored);
  VI index = hn::Add(hn::Mul(hn::Add(hn::Mul(hn::ConvertTo(di, x0), stored), hn::ConvertTo(di, y0)), stored),
                     hn::ConvertTo(di, z0));
  index = hn::Add(index, brick);
  const auto lerp = [](V a, V b, V f) { return hn::Add(a, hn::Mul(f, hn::Sub(b, a))); };
  const auto along_z = [&](int offset) {
#if HWY_TARGET == HWY_SCALAR
    return lerp(hn::GatherIndex(D(), scene.values + offset, index),
                hn::GatherIndex(D(), scene.values + offset + 1, index), fz);
#else
    // Values that lie side by side are gathered as one number of 64 bits: a gather costs by its lanes.
    const hn::Half<DI> half;
    const hn::Rebind<int64_t, decltype(half)> d_bytes;
    const auto pairs = [&](auto part) {
      const auto* const base = reinterpret_cast<const int64_t*>(scene.values + offset);
      return hn::BitCast(D(), hn::GatherOffset(d_bytes, base, hn::ShiftLeft<2>(hn::PromoteTo(d_bytes, part))));
    };
    const V low = pairs(hn::LowerHalf(index)), high = pairs(hn::UpperHalf(half, index));
    return lerp(hn::ConcatEven(D(), high, low), hn::ConcatOdd(D(), high, low), fz);
#endif
  };
  const int Y = scene.stored, X = Y * Y;
  return lerp(lerp(along_z(0), along_z(Y), fy), lerp(along_z(X), along_z(X + Y), fy), fx);
}

/// Walks the rays of a list through the majorant cells. Flights end at a real collision, whose position becomes the
/// path's, or leave the grid; first flights are whole: see render/lanes.h; shadow rays gather their transmittance by
/// ratio tracking; the walk to the medium's surface and the march go voxel by voxel: see render/lanes.h.
template <Walk kWalk>
HWY_INLINE void track(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList* hits, SlotList* escapes,
                      float iso, LaneCamera* camera, TrackCounters& counters) {
  constexpr bool kShadow = kWalk == Walk::kShadow, kSurface = kWalk == Walk::kSurface, kMarch = kWalk == Walk::kMarch;
  constexpr bool kByVoxel = kSurface || kMarch, kFirst = kWalk == Walk::kFirst;
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
  HWY_ALIGN float transmitted[kMost], carried[kMost];
  HWY_ALIGN float result_x[kMost], result_y[kMost], result_z[kMost];
  HWY_ALIGN uint32_t r0[kMost] = {}, r1[kMost] = {}, r2[kMost] = {}, r3[kMost] = {};

  const V zero = hn::Zero(d), one = set(1.0f), cell_size = set(scene.cell), huge = set(1e30f), tiny = set(1e-12f);
  V ox = zero, oy = zero, oz = zero, dx = one, dy = one, dz = one, ix = one, iy = one, iz = one;
  V t = zero, cx = zero, cy = zero, cz = zero, tau = zero, weight = one;
  V px = zero, py = zero, pz = zero, voxel_step = one;
  Generator rng{hn::Zero(du), hn::Zero(du), hn::Zero(du), hn::Zero(du)};
  V offset = zero, level[kMarchedPoints], point[kMarchedPoints];  // of the march
  for (size_t k = 0; k < kMarchedPoints; ++k) level[k] = point[k] = zero;
  V step_begin = zero, reach = one;  // of the walk to the surface
  uint32_t busy = 0, finished = 0, collided = 0, met = 0;
  size_t next = 0;

  const auto index_of_cell = [&](M mask) {
    const V row = hn::Add(hn::Mul(cx, set(scene.ny)), cy);
    const VI index = hn::Add(hn::Mul(hn::ConvertTo(di, row), hn::Set(di, scene.nz_int)), hn::ConvertTo(di, cz));
    return hn::IfThenElseZero(hn::RebindMask(di, mask), index);
  };
  const auto brick_of = [&](VI index, M mask) {
    return hn::GatherIndex(di, scene.brick, hn::IfThenElseZero(hn::RebindMask(di, mask), index));
  };
  // The rays' points at a parameter, relative to their cells.
  const auto in_cell = [&](V at) {
    const auto within = [&](V o, V dir, V c) {
      const V q = hn::Sub(hn::Add(o, hn::Mul(dir, at)), hn::Mul(c, cell_size));
      return hn::Min(hn::Max(q, zero), cell_size);
    };
    return V3{within(ox, dx, cx), within(oy, dy, cy), within(oz, dz, cz)};
  };

  for (;;) {
    const auto free_lanes = static_cast<size_t>(std::popcount(all & ~busy));
    if (busy == 0 || (next < rays.count && free_lanes >= worth_loading)) {
      if (finished) {
        if (kFirst) {
          // What is scattered goes on with its weight; roulette below a hundredth.
          const V scattered = hn::Sub(one, weight), u = rng.uniform(mask_of(finished));
          collided = bits_of(hn::Lt(hn::Mul(u, set(0.01f)), scattered));
          hn::Store(weight, d, transmitted);
          hn::Store(hn::Max(scattered, set(0.01f)), d, carried);
        }
        if (!kSurface) {
          hn::Store(rng.s0, du, r0), hn::Store(rng.s1, du, r1);
          hn::Store(rng.s2, du, r2), hn::Store(rng.s3, du, r3);
        }
        if (kShadow || kMarch) {
          hn::Store(weight, d, result_x);
        } else if (kSurface) {
          // Between the last look-up below the surface's density and the first above, by a straight line.
          const M there = mask_of(finished & collided);
          const V3 q = in_cell(step_begin);
          const V below = hn::Min(interpolated(scene, brick_of(index_of_cell(there), there), q.x, q.y, q.z), set(iso));
          const V share = hn::Div(hn::Sub(set(iso), below), hn::Max(hn::Sub(weight, below), set(1e-30f)));
          hn::Store(hn::Add(step_begin, hn::Mul(hn::Sub(t, step_begin), hn::Min(share, one))), d, result_x);
        } else {
          hn::Store(px, d, result_x), hn::Store(py, d, result_y), hn::Store(pz, d, result_z);
        }
        for (uint32_t left = finished; left; left &= left - 1) {
          const auto lane = static_cast<size_t>(std::countr_zero(left));
          const auto s = static_cast<size_t>(slot[lane]);
          if (!kByVoxel) pool.s0[s] = r0[lane], pool.s1[s] = r1[lane], pool.s2[s] = r2[lane], pool.s3[s] = r3[lane];
          if (kFirst) pool.passed[s] = transmitted[lane], pool.tr[s] = pool.tg[s] = pool.tb[s] = carried[lane];
          if (kShadow) {
            pool.transmittance[s] = result_x[lane];
          } else if (kMarch) {
            camera->depth[s] = result_x[lane];
          } else if (kSurface) {
            camera->surface[s] = collided >> lane & 1 ? result_x[lane] : met >> lane & 1 ? -1.0f : kNothingMet;
          } else if (collided >> lane & 1) {
            pool.ox[s] = result_x[lane], pool.oy[s] = result_y[lane], pool.oz[s] = result_z[lane];
            hits->push(slot[lane]);
          } else {
            escapes->push(slot[lane]);
          }
        }
        if (kMarch) {
          for (size_t k = 0; k < kMarchedPoints; ++k) {
            hn::Store(point[k], d, result_x);
            for (uint32_t left = finished; left; left &= left - 1) {
              const auto lane = static_cast<size_t>(std::countr_zero(left));
              camera->point[k][static_cast<size_t>(slot[lane])] = result_x[lane];
            }
          }
        }
        finished = 0;
      }
      if (next == rays.count) {
        if (busy == 0) break;
      } else {
        hn::Store(ox, d, ax), hn::Store(oy, d, ay), hn::Store(oz, d, az);
        hn::Store(dx, d, bx), hn::Store(dy, d, by), hn::Store(dz, d, bz);
        if (!kSurface) {
          hn::Store(rng.s0, du, r0), hn::Store(rng.s1, du, r1);
          hn::Store(rng.s2, du, r2), hn::Store(rng.s3, du, r3);
        }
        uint32_t loaded = 0;
        for (uint32_t left = all & ~busy; left && next < rays.count; left &= left - 1) {
          const auto lane = static_cast<size_t>(std::countr_zero(left));
          const auto s = static_cast<size_t>(slot[lane] = rays.slot[next++]);
          ax[lane] = pool.ox[s], ay[lane] = pool.oy[s], az[lane] = pool.oz[s];
          bx[lane] = (kShadow ? pool.sx : pool.lx)[s], by[lane] = (kShadow ? pool.sy : pool.ly)[s];
          bz[lane] = (kShadow ? pool.sz : pool.lz)[s];
          if (!kSurface) r0[lane] = pool.s0[s], r1[lane] = pool.s1[s], r2[lane] = pool.s2[s], r3[lane] = pool.s3[s];
          loaded |= 1u << lane;
        }
        ox = hn::Load(d, ax), oy = hn::Load(d, ay), oz = hn::Load(d, az);
        dx = hn::Load(d, bx), dy = hn::Load(d, by), dz = hn::Load(d, bz);
        if (!kSurface) rng = {hn::Load(du, r0), hn::Load(du, r1), hn::Load(du, r2), hn::Load(du, r3)};
        const M fresh = mask_of(loaded);
        // A direction across an axis never reaches its planes.
        const auto inverse = [&](V v) {
          return hn::IfThenElse(hn::Lt(hn::Abs(v), tiny), hn::CopySign(huge, v), hn::Div(one, v));
        };
        ix = inverse(dx), iy = inverse(dy), iz = inverse(dz);
        const auto cell = [&](V o, float n) {
          return hn::Min(hn::Max(hn::Floor(hn::Mul(o, set(scene.inverse_cell))), zero), set(n - 1));
        };
        cx = hn::IfThenElse(fresh, cell(ox, scene.nx), cx);
        cy = hn::IfThenElse(fresh, cell(oy, scene.ny), cy);
        cz = hn::IfThenElse(fresh, cell(oz, scene.nz), cz);
        t = hn::IfThenElse(fresh, zero, t);
        weight = hn::IfThenElse(fresh, kByVoxel ? zero : one, weight);
        if (kSurface) reach = hn::IfThenElse(fresh, one, reach);
        if (kByVoxel)
          voxel_step = hn::Div(one, hn::Sqrt(dot({dx, dy, dz}, {dx, dy, dz})));
        else
          tau = hn::IfThenElse(fresh, rng.exponential(fresh), tau);
        if (kMarch) {
          offset = hn::IfThenElse(fresh, rng.uniform(fresh), offset);
          const V u = rng.uniform(fresh);
          for (size_t k = 0; k < kMarchedPoints; ++k) {
            const V v = hn::Mul(hn::Add(u, set(static_cast<float>(k))), set(1.0f / kMarchedPoints));
            level[k] = hn::IfThenElse(fresh, hn::Neg(log_of(hn::Sub(one, v))), level[k]);
            point[k] = hn::IfThenElse(fresh, set(-1.0f), point[k]);
          }
        }
        met &= ~loaded;
        busy |= loaded;
      }
    }
    const M active = mask_of(busy);

    // The cell: its bound, or how far around it is empty.
    const VI cell_index = index_of_cell(active);
    const V bound = hn::GatherIndex(d, scene.majorant, cell_index);
    const M empty = hn::Lt(bound, zero);
    const V ahead = hn::IfThenElse(empty, hn::Neg(bound), one);  // cells to the far faces
    const V behind = hn::Sub(one, ahead);                        // and to the near ones
    const M right_x = hn::Ge(dx, zero), right_y = hn::Ge(dy, zero), right_z = hn::Ge(dz, zero);
    const auto exit_time = [&](V c, M right, V o, V inverse) {
      const V plane = hn::Mul(hn::Add(c, hn::IfThenElse(right, ahead, behind)), cell_size);
      return hn::Mul(hn::Sub(plane, o), inverse);
    };
    const V tx = exit_time(cx, right_x, ox, ix), ty = exit_time(cy, right_y, oy, iy),
            tz = exit_time(cz, right_z, oz, iz);
    const V exit = hn::Min(hn::Min(tx, ty), tz);
    const V until = hn::Max(exit, t);
    const V sigma_maj = hn::Mul(bound, set(kFirst ? scene.first_sigma : scene.sigma));
    const V remaining = hn::IfThenElse(empty, zero, hn::Mul(hn::Sub(until, t), sigma_maj));
    const M passes = hn::And(active, kSurface ? hn::Or(hn::Lt(bound, set(iso)), hn::Ge(t, until))
                                     : kMarch ? hn::Or(empty, hn::Ge(t, until))
                                              : hn::Or(empty, hn::Ge(tau, remaining)));
    if (kSurface) met |= bits_of(hn::AndNot(empty, active));
    const M collides = hn::AndNot(passes, active);

    // Lanes that cross into another cell. Equal times: the lowest axis first.
    {
      if (!kByVoxel) tau = hn::IfThenElse(passes, hn::Sub(tau, remaining), tau);
      const M first_x = hn::Eq(exit, tx), first_y = hn::AndNot(first_x, hn::Eq(exit, ty));
      const M first_z = hn::Not(hn::Or(first_x, first_y));
      const auto crossed = [&](V c, M first, M right, V o, V dir) {
        const V beyond = hn::Add(c, hn::IfThenElse(right, ahead, hn::Neg(ahead)));
        // On the other axes the cell can change only where several are crossed at once.
        const V at = hn::Floor(hn::Mul(hn::Add(o, hn::Mul(dir, until)), set(scene.inverse_cell)));
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

    // One voxel of the eight around q, by its trilinear weight. Bits: 16 for each axis.
    const auto voxel = [&](V q, V c, VU bits) {
      const V u = hn::Mul(hn::Add(hn::ConvertTo(d, hn::BitCast(di, bits)), set(0.5f)), set(0x1p-16f));
      const V within =
          hn::Min(hn::Max(hn::Sub(q, hn::Mul(c, cell_size)), zero), set(scene.cell - scene.cell * 0x1p-24f));
      return hn::ConvertTo(di, hn::Add(within, u));
    };
    const auto one_voxel = [&](V qx, V qy, V qz, VI brick) {
      const VU low = hn::Set(du, 0xffffu), bits = rng.next(collides), bits_z = rng.next(collides);
      const VI vx = voxel(qx, cx, hn::And(bits, low)), vy = voxel(qy, cy, hn::ShiftRight<16>(bits));
      const VI vz = voxel(qz, cz, hn::ShiftRight<16>(bits_z)), stored = hn::Set(di, scene.stored);
      const VI index = hn::Add(hn::Add(hn::Mul(hn::Add(hn::Mul(vx, stored), vy), stored), vz), brick);
      return hn::GatherIndex(d, scene.values, hn::IfThenElseZero(hn::RebindMask(di, collides), index));
    };

    if constexpr (kMarch) {
      const V t1 = hn::Min(hn::Add(t, voxel_step), until), length = hn::Sub(t1, t);
      const V at = hn::Add(t, hn::Mul(offset, length));
      const VI brick = brick_of(cell_index, collides);
      const V value =
          one_voxel(hn::Add(ox, hn::Mul(dx, at)), hn::Add(oy, hn::Mul(dy, at)), hn::Add(oz, hn::Mul(dz, at)), brick);
      const V sigma = hn::IfThenElseZero(collides, hn::Mul(value, set(scene.sigma)));
      const V after = hn::Add(weight, hn::Mul(sigma, length));
      for (size_t k = 0; k < kMarchedPoints; ++k) {
        const M passed = hn::And(hn::Lt(weight, level[k]), hn::Ge(after, level[k]));
        const V where = hn::Add(t, hn::Div(hn::Sub(level[k], weight), hn::Max(sigma, set(1e-30f))));
        point[k] = hn::IfThenElse(passed, where, point[k]);
      }
      weight = hn::Min(after, set(static_cast<float>(kDeepest)));
      t = hn::IfThenElse(collides, t1, t);
      done = hn::Or(done, hn::And(collides, hn::Ge(weight, set(static_cast<float>(kDeepest)))));
      const uint32_t ended = bits_of(done);
      busy &= ~ended;
      finished |= ended;
      continue;
    }
    if constexpr (kSurface) {
      // As many voxels on as there is nothing to meet; the density is looked up where that ends in a voxel that can
      // reach the surface's.
      const V t1 = hn::Min(hn::Add(t, hn::Mul(reach, voxel_step)), until);
      const V3 q = in_cell(t1);
      const V last = hn::Sub(cell_size, one);
      const auto index = [&](V p) { return hn::ConvertTo(di, hn::Min(p, last)); };
      const VI size = hn::Set(di, scene.stored - 1);
      const VI in_brick = hn::Add(hn::Mul(hn::Add(hn::Mul(index(q.x), size), index(q.y)), size), index(q.z));
      const auto looked_up = hn::RebindMask(di, collides);
      const VI first = hn::GatherIndex(di, scene.distances_of_cell, hn::IfThenElseZero(looked_up, cell_index));
      const VI word = hn::GatherOffset(di, reinterpret_cast<const int32_t*>(scene.distances),
                                       hn::IfThenElseZero(looked_up, hn::Add(first, in_brick)));
      const V distance = hn::ConvertTo(d, hn::And(word, hn::Set(di, 255)));
      const M near = hn::And(collides, hn::Eq(distance, zero));
      M hit = hn::FirstN(d, 0);
      if (!hn::AllFalse(d, near)) {
        const V value = interpolated(scene, brick_of(cell_index, near), q.x, q.y, q.z);
        hit = hn::And(near, hn::Ge(value, set(iso)));
        weight = hn::IfThenElse(hit, value, weight);
      }
      step_begin = hn::IfThenElse(hit, hn::Max(t, hn::Sub(t1, voxel_step)), step_begin);
      t = hn::IfThenElse(collides, t1, t);
      reach = hn::IfThenElse(collides, hn::Max(distance, one), hn::IfThenElse(passes, one, reach));
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
      const VI brick = brick_of(cell_index, collides);
      V value;
      if (scene.interpolate) {
        const auto within = [&](V q, V c) {
          return hn::IfThenElseZero(collides, hn::Min(hn::Max(hn::Sub(q, hn::Mul(c, cell_size)), zero), cell_size));
        };
        value = interpolated(scene, brick, within(qx, cx), within(qy, cy), within(qz, cz));
      } else {
        value = one_voxel(qx, qy, qz, brick);
      }
      counters.lookups += hn::CountTrue(d, collides);
      const V u = rng.uniform(collides);
      if (kFirst) {
        // Each tentative collision scatters its share of what is left; one of them, chosen by share, is the path's.
        // Below half the rest is decided like a usual collision: all of it or nothing.
        const V share = hn::Div(hn::Mul(value, set(scene.sigma)), sigma_maj);
        const M whole = hn::And(collides, hn::Lt(weight, set(0.5f))), decided = hn::And(whole, hn::Lt(u, share));
        const V part = hn::IfThenElse(whole, hn::IfThenElseZero(decided, weight), hn::Mul(weight, share));
        const V before = hn::Sub(one, weight), choice = rng.uniform(collides);
        const M taken = hn::And(collides, hn::Lt(hn::Mul(choice, hn::Add(before, part)), part));
        px = hn::IfThenElse(taken, qx, px), py = hn::IfThenElse(taken, qy, py), pz = hn::IfThenElse(taken, qz, pz);
        weight = hn::IfThenElse(collides, hn::Sub(weight, part), weight);
        done = hn::Or(done, decided);
      } else if (kShadow) {
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
    if (!kShadow && !kFirst) collided &= ~(ended & ~bits_of(hn::And(done, collides)));
    busy &= ~ended;
    finished |= ended;
  }
}

void Flight(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList& hits, SlotList& escapes,
            uint64_t& lookups) {
  TrackCounters counters;
  track<Walk::kFlight>(scene, pool, rays, &hits, &escapes, 0, nullptr, counters);
  lookups += counters.lookups;
}

void First(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList& hits, SlotList& escapes,
           uint64_t& lookups) {
  TrackCounters counters;
  track<Walk::kFirst>(scene, pool, rays, &hits, &escapes, 0, nullptr, counters);
  lookups += counters.lookups;
}

void Shadow(const LaneScene& scene, LanePool& pool, const SlotList& rays, uint64_t& lookups) {
  TrackCounters counters;
  track<Walk::kShadow>(scene, pool, rays, nullptr, nullptr, 0, nullptr, counters);
  lookups += counters.lookups;
}

void Surface(const LaneScene& scene, LanePool& pool, const SlotList& rays, float iso, LaneCamera& camera) {
  TrackCounters counters;
  track<Walk::kSurface>(scene, pool, rays, nullptr, nullptr, iso, &camera, counters);
}

void March(const LaneScene& scene, LanePool& pool, const SlotList& rays, LaneCamera& camera) {
  TrackCounters counters;
  track<Walk::kMarch>(scene, pool, rays, nullptr, nullptr, 0, &camera, counters);
}

void Gradient(const LaneScene& scene, LanePoints& points) {
  const D d;
  const DI di;
  const size_t lanes = hn::Lanes(d);
  const V zero = hn::Zero(d), one = set(1.0f), cell_size = set(scene.cell);
  for (auto* column : {&points.x, &points.y, &points.z})
    std::fill_n(column->begin() + static_cast<std::ptrdiff_t>(points.count), lanes, 0.0f);
  const auto cell = [&](V p, float n, M& outside) {
    const V c = hn::Floor(hn::Mul(p, set(scene.inverse_cell))), nearest = hn::Min(hn::Max(c, zero), set(n - 1));
    outside = hn::Or(outside, hn::Or(hn::Lt(p, zero), hn::Gt(p, hn::Mul(hn::Add(nearest, one), cell_size))));
    return nearest;
  };
  const auto density = [&](V x, V y, V z) {
    M outside = hn::FirstN(d, 0);
    const V cx = cell(x, scene.nx, outside), cy = cell(y, scene.ny, outside), cz = cell(z, scene.nz, outside);
    const V row = hn::Add(hn::Mul(cx, set(scene.ny)), cy);
    const VI index = hn::Add(hn::Mul(hn::ConvertTo(di, row), hn::Set(di, scene.nz_int)), hn::ConvertTo(di, cz));
    outside = hn::Or(outside, hn::Lt(hn::GatherIndex(d, scene.majorant, index), zero));
    const auto within = [&](V p, V c) {
      return hn::IfThenZeroElse(outside, hn::Min(hn::Max(hn::Sub(p, hn::Mul(c, cell_size)), zero), cell_size));
    };
    return hn::IfThenZeroElse(outside, interpolated(scene, hn::GatherIndex(di, scene.brick, index), within(x, cx),
                                                    within(y, cy), within(z, cz)));
  };
  for (size_t i = 0; i < points.count; i += lanes) {
    const V x = hn::LoadU(d, points.x.data() + i), y = hn::LoadU(d, points.y.data() + i),
            z = hn::LoadU(d, points.z.data() + i);
    const V half = set(0.5f);
    const V3 g{hn::Mul(half, hn::Sub(density(hn::Add(x, one), y, z), density(hn::Sub(x, one), y, z))),
               hn::Mul(half, hn::Sub(density(x, hn::Add(y, one), z), density(x, hn::Sub(y, one), z))),
               hn::Mul(half, hn::Sub(density(x, y, hn::Add(z, one)), density(x, y, hn::Sub(z, one))))};
    const M clear = hn::Ge(hn::Sqrt(dot(g, g)), set(scene.least_gradient));
    const V3 world = transform(scene.gradient_to_world, g);
    const V scale = hn::IfThenElseZero(clear, hn::Div(one, hn::Sqrt(dot(world, world))));
    hn::StoreU(hn::Mul(world.x, scale), d, points.gx.data() + i);
    hn::StoreU(hn::Mul(world.y, scale), d, points.gy.data() + i);
    hn::StoreU(hn::Mul(world.z, scale), d, points.gz.data() + i);
  }
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(Flight);
HWY_EXPORT(First);
HWY_EXPORT(Shadow);
HWY_EXPORT(Surface);
HWY_EXPORT(March);
HWY_EXPORT(Gradient);

void lanes_fly(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList& hits, SlotList& escapes,
               uint64_t& lookups) {
  HWY_DYNAMIC_DISPATCH(Flight)(scene, pool, rays, hits, escapes, lookups);
}

void lanes_fly_first(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList& hits, SlotList& escapes,
                     uint64_t& lookups) {
  HWY_DYNAMIC_DISPATCH(First)(scene, pool, rays, hits, escapes, lookups);
}

void lanes_shadow(const LaneScene& scene, LanePool& pool, const SlotList& rays, uint64_t& lookups) {
  HWY_DYNAMIC_DISPATCH(Shadow)(scene, pool, rays, lookups);
}

void lanes_find_surface(const LaneScene& scene, LanePool& pool, const SlotList& rays, float iso, LaneCamera& camera) {
  HWY_DYNAMIC_DISPATCH(Surface)(scene, pool, rays, iso, camera);
}

void lanes_march(const LaneScene& scene, LanePool& pool, const SlotList& rays, LaneCamera& camera) {
  HWY_DYNAMIC_DISPATCH(March)(scene, pool, rays, camera);
}

void lanes_gradient(const LaneScene& scene, LanePoints& points) {
  HWY_DYNAMIC_DISPATCH(Gradient)(scene, points);
}

}  // namespace brume
#endif
