#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/transport/emission.cpp"
#include "render/transport/emission.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <numbers>

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

void Emission(const EmissionCells& cells, PathStates& paths, const SlotList& rays, EmissionSegments& segments) {
  const D d;
  constexpr size_t kMost = RayQueue::kMost;
  const V zero = hn::Zero(d);
  RayQueue queue(rays);
  CellWalk walk(cells);
  GeneratorBuffer generators;
  Generator rng = generators.load();
  HWY_ALIGN float ends[kMost] = {}, strides[kMost] = {};
  V end = zero, step = zero, offset = zero;
  V3 sum = zero3();

  const auto finish = [&]() BRUME_INLINE_LAMBDA {
    Lanes3 emitted;
    emitted.store(sum * cells.unit);
    generators.store(rng);
    queue.collect([&](size_t lane, size_t s) {
      generators.give_back(paths, s, lane);
      segments.emitted.set(s, emitted[lane]);
    });
  };
  const auto load = [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA {
    generators.store(rng);
    const M fresh = mask_of(queue.load([&](size_t lane, size_t s) {
      buffer.fetch(segments.rays, s, lane);
      ends[lane] = segments.rays.end[s];
      strides[lane] = segments.stride[s];
      generators.fetch(paths, s, lane);
    }));
    walk.load(buffer, fresh);
    rng = generators.load();
    end = hn::Load(d, ends);
    step = hn::Load(d, strides) * voxel_length(walk);
    offset = hn::IfThenElse(fresh, rng.uniform(fresh), offset);
    sum = select(fresh, zero3(), sum);
  };
  drive(queue, walk, nullptr, finish, load, [&](M active) BRUME_INLINE_LAMBDA {
    const auto [cell_index, crossing, passes, looks] = walk.look(active);
    const V reached = hn::Min(hn::Min(walk.t + step, crossing.until), end);
    if (!hn::AllFalse(d, looks)) {
      const V3 p = walk.at(walk.t + offset * (reached - walk.t));
      const V value = interpolated(cells, brick_of(cells, cell_index, looks), walk.within(p));
      M glows = looks;
      const RampPlace at = place(cells, value, glows);
      const V part = hn::IfThenElseZero(glows, reached - walk.t);
      const auto colour = [&](int c) { return between_entries(cells.colour[c], at.entry, at.f); };
      sum += V3{colour(0), colour(1), colour(2)} * part;
    }
    const M left = walk.cross(crossing, hn::Or(passes, hn::And(looks, reached >= crossing.until)));
    walk.t = hn::IfThenElse(looks, reached, walk.t);
    queue.end(hn::Or(left, hn::And(active, walk.t >= end)));
  });
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(Emission);

LaneEmission::LaneEmission(const EmissionField& field, const LaneGrid& grid) {
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

}  // namespace brume
#endif
