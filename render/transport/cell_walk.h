// No include guard: see render/transport/vector_math.h.

#include "render/transport/vector_math.h"

/// The rays of a list, and which of them the lanes hold. Finished lanes are refilled when a quarter of them is free:
/// loading costs as much for one lane as for all.
struct RayQueue {
  static constexpr size_t kMost = hn::MaxLanes(D());

  explicit RayQueue(const SlotList& list) : rays(list) {}

  const SlotList& rays;
  size_t next = 0;
  uint32_t busy = 0, finished = 0;  // lanes
  HWY_ALIGN int32_t slot[kMost] = {};

  HWY_INLINE uint32_t all() const {
    const size_t lanes = hn::Lanes(D());
    return lanes >= 32 ? ~0u : (1u << lanes) - 1;
  }
  HWY_INLINE bool due() const {
    const auto free_lanes = static_cast<size_t>(std::popcount(all() & ~busy));
    return busy == 0 || (next < rays.count && free_lanes >= std::max<size_t>(1, hn::Lanes(D()) / 4));
  }
  HWY_INLINE bool exhausted() const { return busy == 0 && next == rays.count; }
  HWY_INLINE void end(M done) {
    const uint32_t bits = bits_of(done);
    busy &= ~bits;
    finished |= bits;
  }
  /// Calls visit(lane, slot) for the finished lanes and forgets them.
  template <class Visit>
  HWY_INLINE void collect(Visit&& visit) {
    for (; finished; finished &= finished - 1) {
      const auto lane = static_cast<size_t>(std::countr_zero(finished));
      visit(lane, static_cast<size_t>(slot[lane]));
    }
  }
  /// Gives rays to free lanes, calls visit(lane, slot) for each and returns which lanes.
  template <class Visit>
  HWY_INLINE uint32_t load(Visit&& visit) {
    uint32_t loaded = 0;
    for (uint32_t left = all() & ~busy; left && next < rays.count; left &= left - 1) {
      const auto lane = static_cast<size_t>(std::countr_zero(left));
      slot[lane] = rays.slot[next++];
      visit(lane, static_cast<size_t>(slot[lane]));
      loaded |= 1u << lane;
    }
    busy |= loaded;
    return loaded;
  }
};

/// The lanes' random generators in memory, while lanes are refilled.
struct GeneratorBuffer {
  HWY_ALIGN uint32_t s[4][RayQueue::kMost] = {};

  HWY_INLINE void store(const Generator& rng) {
    const DU du;
    hn::Store(rng.s0, du, s[0]);
    hn::Store(rng.s1, du, s[1]);
    hn::Store(rng.s2, du, s[2]);
    hn::Store(rng.s3, du, s[3]);
  }
  HWY_INLINE Generator load() const {
    const DU du;
    return {hn::Load(du, s[0]), hn::Load(du, s[1]), hn::Load(du, s[2]), hn::Load(du, s[3])};
  }
  HWY_INLINE void fetch(const PathStates& paths, size_t slot, size_t lane) {
    for (size_t k = 0; k < 4; ++k) s[k][lane] = paths.generator[k][slot];
  }
  HWY_INLINE void give_back(PathStates& paths, size_t slot, size_t lane) const {
    for (size_t k = 0; k < 4; ++k) paths.generator[k][slot] = s[k][lane];
  }
};

/// Rays in local coordinates on their way through the cells, one per lane.
struct CellWalk {
  explicit HWY_INLINE CellWalk(const LaneCells& cells) : grid(cells) {}

  const LaneCells& grid;
  V3 o = zero3(), d{set(1), set(1), set(1)}, inverse = d, cell = zero3();
  V t = hn::Zero(D());
  VU octant_shift = hn::Zero(DU());

  struct Buffer {
    Lanes3 o, d;
    HWY_INLINE void fetch(const Column3& origins, const Column3& directions, size_t slot, size_t lane) {
      o.set(lane, origins[slot]);
      d.set(lane, directions[slot]);
    }
    HWY_INLINE void fetch(const LocalRays& rays, size_t slot, size_t lane) { fetch(rays.o, rays.d, slot, lane); }
  };
  HWY_INLINE void store(Buffer& b) const {
    b.o.store(o);
    b.d.store(d);
  }
  /// Loads the rays; the lanes of `fresh` start at the ray parameter 0, or at `begin`.
  HWY_INLINE void load(const Buffer& b, M fresh) { load(b, fresh, hn::Zero(D())); }
  HWY_INLINE void load(const Buffer& b, M fresh, V begin) {
    const DI di;
    o = b.o.load();
    d = b.d.load();
    // A direction perpendicular to an axis never reaches its planes.
    const auto inverted = [](V v) {
      return hn::IfThenElse(hn::Abs(v) < 1e-12f, hn::CopySign(set(1e30f), v), 1.0f / v);
    };
    inverse = {inverted(d.x), inverted(d.y), inverted(d.z)};
    const auto bits = [&](V v, int32_t shift) { return hn::BroadcastSignBit(hn::BitCast(di, v)) & shift; };
    octant_shift = hn::BitCast(DU(), bits(inverse.x, 12) + (bits(inverse.y, 6) + bits(inverse.z, 3)));
    t = hn::IfThenElse(fresh, begin, t);
    const V3 first = max(floor(at(t) * grid.inverse_cell), zero3());
    cell = select(fresh, min(first, {set(grid.nx - 1), set(grid.ny - 1), set(grid.nz - 1)}), cell);
  }

  /// 0 outside `mask`.
  HWY_INLINE VI index(M mask) const {
    const DI di;
    const V row = cell.x * grid.ny + cell.y;
    const VI i = hn::ConvertTo(di, row) * grid.nz_int + hn::ConvertTo(di, cell.z);
    return hn::IfThenElseZero(hn::RebindMask(di, mask), i);
  }
  HWY_INLINE V3 at(V parameter) const { return o + d * parameter; }
  /// A point relative to the lanes' cells, clamped to [0, most].
  HWY_INLINE V3 within(const V3& p, V most) const {
    return min(max(p - cell * grid.cell, zero3()), {most, most, most});
  }
  HWY_INLINE V3 within(const V3& p) const { return within(p, set(grid.cell)); }

  /// Where the rays leave their cells, or the cubes of empty cells that OctantSkip lets them skip.
  struct Crossing {
    V3 sign, last;  // of the direction; the last cell before the exit on each axis
    V tx, ty;       // ray parameters of the exit faces
    V exit, until;
  };
  /// @param word  the cells' entries in LaneGrid::majorant   @param empty  those that hold an OctantSkip
  HWY_INLINE Crossing ahead(VI word, M empty) const {
    const DI di;
    const VI steps = hn::BitCast(di, hn::Shr(hn::BitCast(DU(), word), octant_shift)) & 7;
    const VI step = hn::ShiftRight<OctantSkip::kStepShift>(word) & 63;
    const V far = hn::IfThenElseZero(empty, hn::ConvertTo(D(), steps * step));
    const V one = set(1.0f);
    Crossing c;
    c.sign = {hn::CopySign(one, inverse.x), hn::CopySign(one, inverse.y), hn::CopySign(one, inverse.z)};
    c.last = cell + c.sign * far;
    const V3 exits = (max(c.last, c.last + c.sign) * grid.cell - o) * inverse;
    c.tx = exits.x;
    c.ty = exits.y;
    c.exit = hn::Min(hn::Min(exits.x, exits.y), exits.z);
    c.until = hn::Max(c.exit, t);
    return c;
  }
  /// For marches that sample once per voxel length: which lanes sample in their cell, and which move to the next one,
  /// because theirs is empty or they are at its end.
  struct Look {
    VI cell;
    Crossing crossing;
    M passes, looks;
  };
  HWY_INLINE Look look(M active) const {
    const VI here = index(active);
    const V bound = hn::GatherIndex(D(), grid.majorant, here);
    const M empty = bound < 0.0f;
    const Crossing crossing = ahead(hn::BitCast(DI(), bound), empty);
    const M passes = hn::And(active, hn::Or(empty, t >= crossing.until));
    return {here, crossing, passes, hn::AndNot(passes, active)};
  }
  /// Moves the lanes of `passes` into the next cells; returns which of them have left the grid. Where two faces are
  /// reached at the same parameter, the lowest axis goes first.
  HWY_INLINE M cross(const Crossing& c, M passes) {
    const M first_x = c.exit == c.tx, first_y = hn::AndNot(first_x, c.exit == c.ty);
    const M first_z = hn::Not(hn::Or(first_x, first_y));
    // On the other axes the cell changes only where a cube of several cells is skipped.
    const V3 other = floor(at(c.until) * grid.inverse_cell), next = c.last + c.sign;
    const V3 between = min(max(other, min(cell, c.last)), max(cell, c.last));
    cell = select(passes,
                  {hn::IfThenElse(first_x, next.x, between.x), hn::IfThenElse(first_y, next.y, between.y),
                   hn::IfThenElse(first_z, next.z, between.z)},
                  cell);
    t = hn::IfThenElse(passes, c.until, t);
    const auto left = [](V v, float n) { return hn::Or(v < 0.0f, v >= n); };
    return hn::And(passes, hn::Or(left(cell.x, grid.nx), hn::Or(left(cell.y, grid.ny), left(cell.z, grid.nz))));
  }
};

/// Runs the rays of a queue to their ends, as many at a time as there are lanes.
/// @param stop    polled every 4096 steps, may be null: throws Interrupted where it says so
/// @param finish  writes back the results of the finished lanes, through RayQueue::collect
/// @param load    refills free lanes, through RayQueue::load; its buffer holds the rays of the busy lanes
/// @param step    (M active) advances the active lanes by one step and ends those that are done, through RayQueue::end
template <class Finish, class Load, class Step>
HWY_INLINE void drive(RayQueue& queue, const CellWalk& walk, const StopSignal* stop, Finish&& finish, Load&& load,
                      Step&& step) {
  CellWalk::Buffer buffer;
  for (uint32_t steps = 1;; ++steps) {
    if (queue.due()) {
      if (queue.finished) finish();
      if (queue.exhausted()) return;
      if (queue.next < queue.rays.count) {
        walk.store(buffer);
        load(buffer);
      }
    }
    if ((steps & 0xfff) == 0 && stop != nullptr) stop->check();
    step(mask_of(queue.busy));
  }
}

/// Length of a voxel as a ray parameter.
HWY_INLINE V voxel_length(const CellWalk& walk) {
  return 1.0f / length(walk.d);
}

/// Offsets of the cells' bricks in the grid's values; 0 outside `mask`, whose cells must not be empty.
HWY_INLINE VI brick_of(const LaneCells& grid, VI cell, M mask) {
  const DI di;
  return hn::IfThenElseZero(hn::RebindMask(di, mask), hn::GatherIndex(di, grid.brick, cell));
}

HWY_INLINE V lerp(V a, V b, V f) {
  return a + f * (b - a);
}

/// Two neighbouring entries of a table. @param index  of the first
struct EntryPair {
  V first, second;
};
HWY_INLINE EntryPair entry_pair(const float* table, VI index) {
#if HWY_TARGET == HWY_SCALAR
  return {hn::GatherIndex(D(), table, index), hn::GatherIndex(D(), table + 1, index)};
#else
  // Both are gathered as one 64-bit number: the cost of a gather is per lane.
  const hn::Half<DI> half;
  const hn::Rebind<int64_t, decltype(half)> d_bytes;
  const auto pairs = [&](auto part) {
    const auto* const base = reinterpret_cast<const int64_t*>(table);
    return hn::BitCast(D(), hn::GatherOffset(d_bytes, base, hn::ShiftLeft<2>(hn::PromoteTo(d_bytes, part))));
  };
  const V low = pairs(hn::LowerHalf(index)), high = pairs(hn::UpperHalf(half, index));
  return {hn::ConcatEven(D(), high, low), hn::ConcatOdd(D(), high, low)};
#endif
}

/// Linear interpolation between them.
HWY_INLINE V between_entries(const float* table, VI index, V f) {
  const EntryPair pair = entry_pair(table, index);
  return lerp(pair.first, pair.second, f);
}

/// Points in voxels, the cubes between eight values.
struct InVoxel {
  VI index;  ///< of the lowest corner's value
  V3 f;      ///< relative to that corner, in [0, 1]
};

/// @param brick  offsets from brick_of
/// @param q      points relative to the cell, in [0, cell]
HWY_INLINE InVoxel voxel_at(const LaneCells& grid, VI brick, const V3& q) {
  const DI di;
  const V highest = set(grid.cell - 1.0f);
  const V3 at = min(floor(q), {highest, highest, highest});
  const VI stored = hn::Set(di, grid.stored);
  const VI index = (hn::ConvertTo(di, at.x) * stored + hn::ConvertTo(di, at.y)) * stored + hn::ConvertTo(di, at.z);
  return {index + brick, q - at};
}

/// The density between the eight values.
HWY_INLINE V interpolated(const LaneCells& grid, const InVoxel& at) {
  const auto along_z = [&](int offset) { return between_entries(grid.values + offset, at.index, at.f.z); };
  const int Y = grid.stored, X = Y * Y;
  return lerp(lerp(along_z(0), along_z(Y), at.f.y), lerp(along_z(X), along_z(X + Y), at.f.y), at.f.x);
}
HWY_INLINE V interpolated(const LaneCells& grid, VI brick, const V3& q) {
  return interpolated(grid, voxel_at(grid, brick, q));
}

/// The interpolated density at points anywhere.
HWY_INLINE V density_at(const LaneCells& grid, const V3& p) {
  const D d;
  const DI di;
  const V zero = hn::Zero(d), one = set(1.0f), cell_size = set(grid.cell);
  M outside = hn::FirstN(d, 0);
  const auto cell = [&](V v, float n) {
    const V c = hn::Floor(v * grid.inverse_cell), nearest = hn::Min(hn::Max(c, zero), set(n - 1));
    outside = hn::Or(outside, hn::Or(v > (nearest + one) * cell_size, v < zero));
    return nearest;
  };
  const V3 c{cell(p.x, grid.nx), cell(p.y, grid.ny), cell(p.z, grid.nz)};
  const V row = c.x * grid.ny + c.y;
  const VI index = hn::ConvertTo(di, row) * grid.nz_int + hn::ConvertTo(di, c.z);
  const VI brick = hn::GatherIndex(di, grid.brick, index);
  outside = hn::Or(outside, hn::RebindMask(d, brick < 0));
  const auto within = [&](V v, V from) {
    return hn::IfThenZeroElse(outside, hn::Min(hn::Max(v - from * cell_size, zero), cell_size));
  };
  const V3 q{within(p.x, c.x), within(p.y, c.y), within(p.z, c.z)};
  return hn::IfThenZeroElse(outside, interpolated(grid, hn::Max(brick, hn::Zero(di)), q));
}

/// Where the density that is now at points of a displaced grid, envelope coordinates, is stored. @param time  in frames
HWY_INLINE V3 stored_at(const LaneScene& scene, const V3& p, V time) {
  const auto stored = [&](size_t axis, V x) {
    const V there = x - scene.origin_shift[axis];
    const LaneCells& field = scene.displacement[axis];
    return field.values ? there - time * density_at(field, p) : there;
  };
  return {stored(0, p.x), stored(1, p.y), stored(2, p.z)};
}

/// The density at those points.
HWY_INLINE V displaced_density(const LaneScene& scene, const V3& p, V time) {
  return density_at(scene.density, stored_at(scene, p, time));
}

/// One voxel of the eight around points of the walk's cells, drawn by its trilinear weight.
HWY_INLINE V one_voxel(const CellWalk& walk, Generator& rng, const V3& p, VI brick, M mask) {
  const DI di;
  const DU du;
  const LaneCells& grid = walk.grid;
  const V3 q = walk.within(p, set(grid.cell - grid.cell * 0x1p-24f));
  const auto voxel = [&](V v, VU bits) {  // 16 of them
    const V u = (hn::ConvertTo(D(), hn::BitCast(di, bits)) + 0.5f) * 0x1p-16f;
    return hn::ConvertTo(di, v + u);
  };
  const VU low = hn::Set(du, 0xffffu), bits = rng.next(mask), bits_z = rng.next(mask);
  const VI vx = voxel(q.x, hn::And(bits, low)), vy = voxel(q.y, hn::ShiftRight<16>(bits));
  const VI vz = voxel(q.z, hn::ShiftRight<16>(bits_z)), stored = hn::Set(di, grid.stored);
  const VI index = (vx * stored + vy) * stored + vz + brick;
  return hn::GatherIndex(D(), grid.values, hn::IfThenElseZero(hn::RebindMask(di, mask), index));
}
