#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/transport/emission.cpp"
#include "render/transport/emission.h"

#include <hwy/aligned_allocator.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <new>
#include <numbers>
#include <span>

#include "volume/lane_grid.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/cell_walk.h"

/// Which entries of the ramp a value lies between, and where; `glows` is cleared where nothing is emitted.
struct RampPlace {
  VI entry;
  V f;
};
HWY_INLINE RampPlace place(const EmissionCells& cells, V value, M& glows) {
  const D d;
  const DI di;
  const V zero = hn::Zero(d);
  if (cells.blackbody) {
    const V kelvin = cells.offset + cells.scale * value;
    glows = hn::And(glows, hn::And(value > zero, kelvin >= EmissionRamp::kColdest));
    const VI bits = hn::IfThenElseZero(hn::RebindMask(di, glows),
                                       hn::BitCast(di, kelvin) - static_cast<int>(EmissionRamp::kColdestBits));
    const VI entry = hn::Min(hn::ShiftRight<EmissionRamp::kEntryBits>(bits), hn::Set(di, cells.last));
    const VI within = hn::And(bits, hn::Set(di, (1 << EmissionRamp::kEntryBits) - 1));
    return {entry, hn::ConvertTo(d, within) * (1.0f / (1 << EmissionRamp::kEntryBits))};
  }
  VI entry = hn::Zero(di);
  if (cells.last < 16) {
    for (int32_t k = 1; k <= cells.last; ++k)
      entry = hn::IfThenElse(hn::RebindMask(di, value >= cells.stops[k]), hn::Set(di, k), entry);
  } else {
    for (int32_t step = static_cast<int32_t>(std::bit_floor(static_cast<uint32_t>(cells.last))); step > 0; step /= 2) {
      const VI next = entry + step;
      const VI at = hn::Min(next, hn::Set(di, cells.last));
      const M reaches =
          hn::And(value >= hn::GatherIndex(d, cells.stops, at), hn::RebindMask(d, (cells.last + 1) > next));
      entry = hn::IfThenElse(hn::RebindMask(di, reaches), next, entry);
    }
  }
  const V from = hn::GatherIndex(d, cells.stops, entry), inverse = hn::GatherIndex(d, cells.inverse_widths, entry);
  return {entry, hn::Min(hn::Max((value - from) * inverse, zero), set(1.0f))};
}

/// Paths through an emitting field, one per lane.
struct EmissionWalk {
  const EmissionCells& cells;
  PathStates& paths;
  EmissionSegments& segments;
  RayQueue queue;
  CellWalk walk;
  GeneratorBuffer generators;
  Generator rng = generators.load();
  HWY_ALIGN float ends[RayQueue::kMost] = {}, strides[RayQueue::kMost] = {};
  V end = hn::Zero(D()), stratum = end, offset = end;
  V3 sum = zero3();

  HWY_INLINE EmissionWalk(const EmissionCells& field, PathStates& states, const SlotList& rays, EmissionSegments& parts)
      : cells(field), paths(states), segments(parts), queue(rays), walk(field) {}

  HWY_INLINE void finish() {
    Lanes3 emitted;
    emitted.store(sum * cells.unit);
    generators.store(rng);
    queue.collect([&](size_t lane, size_t s) {
      generators.give_back(paths, s, lane);
      segments.emitted.set(s, emitted[lane]);
    });
  }

  /// Refills free lanes. @param fetch  (lane, slot) fetches what else belongs to a path. Returns which are fresh
  template <class Fetch>
  HWY_INLINE uint32_t load(CellWalk::Buffer& buffer, Fetch&& fetch) {
    generators.store(rng);
    const uint32_t loaded = queue.load([&](size_t lane, size_t s) {
      buffer.fetch(segments.rays, s, lane);
      ends[lane] = segments.rays.end[s];
      strides[lane] = segments.stride[s];
      generators.fetch(paths, s, lane);
      fetch(lane, s);
    });
    const M fresh = mask_of(loaded);
    walk.load(buffer, fresh);
    rng = generators.load();
    end = hn::Load(D(), ends);
    stratum = hn::Load(D(), strides) * voxel_length(walk);
    offset = hn::IfThenElse(fresh, rng.uniform(fresh), offset);
    sum = select(fresh, zero3(), sum);
    return loaded;
  }

  /// Crosses a stratum, or what is empty ahead. @param found  (glows, t, part, voxel) gets the look-up at the ray
  /// parameter t, where it glows. Returns who has left the field
  template <class Found>
  HWY_INLINE M step(M active, Found&& found) {
    const D d;
    const auto [cell_index, crossing, passes, looks] = walk.look(active);
    const V reached = hn::Min(hn::Min(walk.t + stratum, crossing.until), end);
    if (!hn::AllFalse(d, looks)) {
      const V t = walk.t + offset * (reached - walk.t);
      const InVoxel voxel = voxel_at(cells, brick_of(cells, cell_index, looks), walk.within(walk.at(t)));
      M glows = looks;
      const RampPlace at = place(cells, interpolated(cells, voxel), glows);
      const auto colour = [&](int c) { return between_entries(cells.colour[c], at.entry, at.f); };
      found(glows, t, V3{colour(0), colour(1), colour(2)} * hn::IfThenElseZero(glows, reached - walk.t), voxel);
    }
    const M left = walk.cross(crossing, hn::Or(passes, hn::And(looks, reached >= crossing.until)));
    walk.t = hn::IfThenElse(looks, reached, walk.t);
    return hn::Or(left, hn::And(active, walk.t >= end));
  }
};

void Emission(const EmissionCells& cells, PathStates& paths, const SlotList& rays, EmissionSegments& segments) {
  const D d;
  EmissionWalk e(cells, paths, rays, segments);
  HWY_ALIGN float befores[RayQueue::kMost] = {}, rivals[RayQueue::kMost] = {};
  V before = hn::Zero(d), rival = before;
  const auto finish = [&]() BRUME_INLINE_LAMBDA { e.finish(); };
  const auto load = [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA {
    e.load(buffer, [&](size_t lane, size_t s) {
      befores[lane] = segments.before[s];
      rivals[lane] = segments.rival[s];
    });
    before = hn::Load(d, befores);
    rival = hn::Load(d, rivals);
  };
  drive(e.queue, e.walk, nullptr, finish, load, [&](M active) BRUME_INLINE_LAMBDA {
    e.queue.end(e.step(active, [&](M glows, V t, const V3& part, const InVoxel& voxel) BRUME_INLINE_LAMBDA {
      if (!cells.densities) {
        e.sum += part;
        return;
      }
      const VI index = hn::IfThenElseZero(hn::RebindMask(DI(), glows), voxel.index);
      const V r = before + t, density = hn::GatherIndex(d, cells.densities, index);
      e.sum += part * (1.0f / (1.0f + rival * density * r * r));
    }));
  });
}

/// The optical depth that rays have crossed of a medium.
struct DepthWalk {
  const LaneScene& medium;
  CellWalk walk;
  V depth = hn::Zero(D()), end = hn::Zero(D());
  CellWalk::Buffer buffer;
  HWY_ALIGN float ends[RayQueue::kMost] = {};

  explicit HWY_INLINE DepthWalk(const LaneScene& of) : medium(of), walk(of) {}

  HWY_INLINE void fetch(const LocalRays& rays, size_t slot, size_t lane) {
    buffer.fetch(rays, slot, lane);
    ends[lane] = rays.end[slot];
  }
  HWY_INLINE void load(M fresh) {
    walk.load(buffer, fresh);
    depth = hn::IfThenElse(fresh, hn::Zero(D()), depth);
    end = hn::IfThenElse(fresh, hn::Load(D(), ends), end);
  }
  HWY_INLINE M before(V parameter) const { return walk.t < hn::Min(parameter, end); }

  /// Goes on to the next voxel, cell or end.
  HWY_INLINE void step(M active, V to) {
    const auto [cell, crossing, passes, looks] = walk.look(active);
    const V reached = hn::Max(walk.t, hn::Min(hn::Min(crossing.until, next_plane()), hn::Min(to, end)));
    if (!hn::AllFalse(D(), looks)) {
      const V half = 0.5f * (reached - walk.t), middle = walk.t + half;
      const V density = gauss(brick_of(medium, cell, looks), middle, half * 0.577350269f);
      depth = hn::IfThenElse(looks, depth + half * density * medium.sigma, depth);
    }
    const M left = walk.cross(crossing, hn::Or(passes, hn::And(looks, reached >= crossing.until)));
    walk.t = hn::IfThenElse(looks, reached, walk.t);
    end = hn::IfThenElse(left, walk.t, end);
  }

 private:
  /// Where the rays leave their voxels. Closer than kClose to a plane they have crossed it.
  HWY_INLINE V next_plane() const {
    constexpr float kClose = 1e-4f;
    const V3 p = walk.at(walk.t);
    const auto plane = [](V at, V o, V inverse) {
      const V sign = hn::CopySign(set(1.0f), inverse), ahead = sign * at + kClose;
      return (sign * (hn::Floor(ahead) + 1.0f) - o) * inverse;
    };
    return hn::Min(hn::Min(plane(p.x, walk.o.x, walk.inverse.x), plane(p.y, walk.o.y, walk.inverse.y)),
                   plane(p.z, walk.o.z, walk.inverse.z));
  }
  /// The sum of the densities at both points of a voxel.
  HWY_INLINE V gauss(VI brick, V middle, V apart) const {
    const DI di;
    const V3 q = walk.within(walk.at(middle));
    const V highest = set(medium.cell - 1.0f);
    const V3 voxel = min(floor(q), {highest, highest, highest}), at = q - voxel, d = walk.d * apart;
    const VI stored = hn::Set(di, medium.stored);
    const VI index = (hn::ConvertTo(di, voxel.x) * stored + hn::ConvertTo(di, voxel.y)) * stored +
                     hn::ConvertTo(di, voxel.z) + brick;
    const int Y = medium.stored, X = Y * Y;
    const EntryPair a = entry_pair(medium.values, index), b = entry_pair(medium.values + Y, index),
                    c = entry_pair(medium.values + X, index), e = entry_pair(medium.values + X + Y, index);
    const auto value = [&](const V3& f) {
      const auto along_z = [&](const EntryPair& pair) { return lerp(pair.first, pair.second, f.z); };
      return lerp(lerp(along_z(a), along_z(b), f.y), lerp(along_z(c), along_z(e), f.y), f.x);
    };
    return value(at - d) + value(at + d);
  }
};

/// The optical depth of a medium along rays through an emitting field, whose ray parameters it is asked for.
struct Dimming {
  const DimmedSegments& of;
  const bool grid;
  DepthWalk crossed;
  HWY_ALIGN float scales[RayQueue::kMost] = {}, offsets[RayQueue::kMost] = {};
  V scale = hn::Zero(D()), offset = scale;

  explicit HWY_INLINE Dimming(const DimmedSegments& dimmed)
      : of(dimmed), grid(dimmed.medium->values != nullptr), crossed(*dimmed.medium) {}

  HWY_INLINE void store() {
    if (grid) crossed.walk.store(crossed.buffer);
    hn::Store(crossed.end, D(), crossed.ends);
  }
  HWY_INLINE void fetch(size_t lane, size_t slot) {
    if (grid)
      crossed.fetch(of.rays, slot, lane);
    else
      crossed.ends[lane] = of.rays.end[slot];
    scales[lane] = of.scale[slot];
    offsets[lane] = of.offset[slot];
  }
  HWY_INLINE void load(M fresh) {
    const D d;
    if (grid)
      crossed.load(fresh);
    else
      crossed.end = hn::Load(d, crossed.ends);
    scale = hn::Load(d, scales);
    offset = hn::Load(d, offsets);
  }
  /// Which rays have yet to walk on before their depth up to t is known.
  HWY_INLINE M behind(M active, V t) const {
    return grid ? hn::And(active, crossed.before(t * scale + offset)) : hn::FirstN(D(), 0);
  }
  HWY_INLINE void step(M behind, V t) { crossed.step(behind, t * scale + offset); }
  HWY_INLINE V depth(V t) const {
    return grid ? crossed.depth : hn::Min(hn::Max(t * scale + offset, hn::Zero(D())), crossed.end);
  }
};

void SeenEmission(const EmissionCells& cells, std::span<const std::unique_ptr<DimmedSegments>> media, PathStates& paths,
                  const SlotList& rays, EmissionSegments& segments) {
  const D d;
  // Below this transmittance one ray of four goes on.
  constexpr float kLeast = 0.01f, kSurvival = 0.25f;
  const V zero = hn::Zero(d), one = set(1.0f);
  EmissionWalk e(cells, paths, rays, segments);
  // A container's own code would not be compiled for these vectors.
  const auto memory = hwy::AllocateAligned<uint8_t>(media.size() * sizeof(Dimming));
  const std::span<Dimming> dimming(reinterpret_cast<Dimming*>(memory.get()), media.size());
  bool chromatic = false;
  const StopSignal* stop = nullptr;
  for (size_t m = 0; m < media.size(); ++m) {
    new (&dimming[m]) Dimming(*media[m]);
    chromatic = chromatic || media[m]->medium->chromatic;
    stop = media[m]->medium->stop;
  }
  V3 pending = zero3();  // of the last look-up, at `wanted`
  V wanted = zero, weight = one;
  uint32_t over = 0;  // lanes that have left the field

  const auto finish = [&]() BRUME_INLINE_LAMBDA { e.finish(); };
  const auto load = [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA {
    for (Dimming& medium : dimming) medium.store();
    const uint32_t loaded = e.load(buffer, [&](size_t lane, size_t s) {
      for (Dimming& medium : dimming) medium.fetch(lane, s);
    });
    const M fresh = mask_of(loaded);
    over &= ~loaded;
    for (Dimming& medium : dimming) medium.load(fresh);
    wanted = hn::IfThenElse(fresh, zero, wanted);
    weight = hn::IfThenElse(fresh, one, weight);
    pending = select(fresh, zero3(), pending);
  };
  const auto transmittance = [&]() BRUME_INLINE_LAMBDA -> V3 {
    if (!chromatic) {
      V depth = zero;
      for (const Dimming& medium : dimming) depth = depth + medium.depth(wanted);
      const V passes = exponential(-depth);
      return {passes, passes, passes};
    }
    V3 depths = zero3();
    for (const Dimming& medium : dimming) depths += set3(medium.of.medium->extinction_ratio) * medium.depth(wanted);
    return {exponential(-depths.x), exponential(-depths.y), exponential(-depths.z)};
  };
  drive(e.queue, e.walk, stop, finish, load, [&](M active) BRUME_INLINE_LAMBDA {
    M ready = active;
    for (Dimming& medium : dimming) {
      const M behind = medium.behind(active, wanted);
      if (2 * hn::CountTrue(d, behind) >= hn::CountTrue(d, active)) return medium.step(behind, wanted);
      ready = hn::AndNot(behind, ready);
    }
    if (hn::AllFalse(d, ready)) {
      for (Dimming& medium : dimming)
        if (medium.grid) medium.step(medium.behind(active, wanted), wanted);
      return;
    }
    const V3 passes = transmittance() * weight;
    e.sum = select(ready, e.sum + pending * passes, e.sum);
    pending = select(ready, zero3(), pending);
    const M faint = hn::And(ready, max_component(passes) < kLeast);
    const M dies = hn::And(faint, e.rng.uniform(faint) >= kSurvival);
    weight = hn::IfThenElse(faint, weight * (1 / kSurvival), weight);
    const M ends_here = hn::Or(dies, hn::And(ready, mask_of(over)));
    e.queue.end(ends_here);
    over |= bits_of(
        e.step(hn::AndNot(ends_here, ready), [&](M glows, V t, const V3& part, const InVoxel&) BRUME_INLINE_LAMBDA {
          pending = select(glows, part, pending);
          wanted = hn::IfThenElse(glows, t, wanted);
        }));
  });
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(Emission);
HWY_EXPORT(SeenEmission);

LaneEmission::LaneEmission(const EmissionField& field, const LaneGrid& grid, const FieldLight* field_light)
    : light(field_light) {
  const Medium& shape = field.shape();
  const auto [lo, hi] = shape.support();
  box = {&shape.placement().to_local(), false, lo, hi, dvec3(0), lane_unit(shape)};
  set_cells(cells, grid);
  const EmissionRamp& ramp = field.ramp();
  const auto floats = [](const auto& values, const auto& of) {
    std::vector<float> result;
    for (const auto& v : values) result.push_back(static_cast<float>(of(v)));
    return result;
  };
  for (int c = 0; c < 3; ++c) {
    table[c] = floats(ramp.entries(), [c](const dvec3& entry) { return entry[c]; });
    cells.colour[c] = table[c].data();
  }
  stops = floats(ramp.stops(), [](double v) { return v; });
  for (size_t i = 0; i + 1 < stops.size(); ++i) {
    const double width = ramp.stops()[i + 1] - ramp.stops()[i];
    inverse_widths.push_back(width > 0 ? static_cast<float>(1 / width) : 0.0f);
  }
  cells.unit = static_cast<float>(box.unit);
  cells.densities = light ? light->densities().data() : nullptr;
  cells.blackbody = ramp.is_blackbody();
  cells.offset = static_cast<float>(ramp.offset());
  cells.scale = static_cast<float>(ramp.scale());
  cells.stops = stops.data();
  cells.inverse_widths = inverse_widths.data();
  cells.last = static_cast<int32_t>(ramp.entries().size()) - 2;
}

void lanes_emission(const EmissionCells& cells, PathStates& paths, const SlotList& rays, EmissionSegments& segments) {
  HWY_DYNAMIC_DISPATCH(Emission)(cells, paths, rays, segments);
}

void lanes_seen_emission(const EmissionCells& cells, std::span<const std::unique_ptr<DimmedSegments>> media,
                         PathStates& paths, const SlotList& rays, EmissionSegments& segments) {
  HWY_DYNAMIC_DISPATCH(SeenEmission)(cells, media, paths, rays, segments);
}

}  // namespace brume
#endif
