#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/lanes/emission.cpp"
#include "render/lanes/emission.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "volume/lane_grid.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/lanes/cell_walk.h"

void Emission(const EmissionCells& glow, PathStates& paths, const SlotList& rays, EmissionSegments& segments) {
  const D d;
  const DI di;
  constexpr size_t kMost = RayQueue::kMost;
  const V zero = hn::Zero(d);
  RayQueue queue(rays);
  CellWalk walk(glow);
  CellWalk::Buffer buffer;
  GeneratorBuffer generators;
  Generator rng = generators.load();
  HWY_ALIGN float ends[kMost] = {}, strides[kMost] = {};
  V end = zero, step = zero, offset = zero;
  V3 sum{zero, zero, zero};
  for (;;) {
    if (queue.due()) {
      if (queue.finished) {
        HWY_ALIGN float r[kMost], g[kMost], b[kMost];
        hn::Store(sum.x, d, r), hn::Store(sum.y, d, g), hn::Store(sum.z, d, b);
        generators.store(rng);
        queue.collect([&](size_t lane, size_t s) {
          generators.give_back(paths, s, lane);
          segments.r[s] = r[lane], segments.g[s] = g[lane], segments.b[s] = b[lane];
        });
      }
      if (queue.exhausted()) break;
      if (queue.next < rays.count) {
        generators.store(rng);
        walk.store(buffer);
        const M fresh = mask_of(queue.load([&](size_t lane, size_t s) {
          buffer.ox[lane] = segments.ox[s], buffer.oy[lane] = segments.oy[s], buffer.oz[lane] = segments.oz[s];
          buffer.dx[lane] = segments.dx[s], buffer.dy[lane] = segments.dy[s], buffer.dz[lane] = segments.dz[s];
          ends[lane] = segments.end[s], strides[lane] = segments.stride[s];
          generators.fetch(paths, s, lane);
        }));
        walk.load(buffer, fresh);
        rng = generators.load();
        end = hn::Load(d, ends);
        step = hn::Mul(hn::Load(d, strides), voxel_length(walk));
        offset = hn::IfThenElse(fresh, rng.uniform(fresh), offset);
        sum = {hn::IfThenElse(fresh, zero, sum.x), hn::IfThenElse(fresh, zero, sum.y),
               hn::IfThenElse(fresh, zero, sum.z)};
      }
    }
    const M active = mask_of(queue.busy);
    const auto [cell_index, crossing, passes, looks] = walk.look(active);
    const V reached = hn::Min(hn::Min(hn::Add(walk.t, step), crossing.until), end);
    if (!hn::AllFalse(d, looks)) {
      const V part = hn::IfThenElseZero(looks, hn::Sub(reached, walk.t));
      const V3 p = walk.at(hn::Add(walk.t, hn::Mul(offset, part)));
      const V value = interpolated(glow, brick_of(glow, cell_index, looks), walk.within(p));
      const V entry =
          hn::Min(hn::Max(hn::Mul(hn::Sub(value, set(glow.lowest)), set(glow.scale)), zero), set(glow.last));
      const V first = hn::Min(hn::Floor(entry), set(glow.last - 1.0f)), f = hn::Sub(entry, first);
      const auto add = [&](V& to, const float* table) {
        to = hn::Add(to, hn::Mul(part, between_entries(table, hn::ConvertTo(di, first), f)));
      };
      add(sum.x, glow.colour[0]), add(sum.y, glow.colour[1]), add(sum.z, glow.colour[2]);
    }
    const M left = walk.cross(crossing, hn::Or(passes, hn::And(looks, hn::Ge(reached, crossing.until))));
    walk.t = hn::IfThenElse(looks, reached, walk.t);
    queue.end(hn::Or(left, hn::And(active, hn::Ge(walk.t, end))));
  }
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(Emission);

LaneEmission::LaneEmission(const EmissionField& field, const LaneGrid& grid)
    : shape(field.shape()), box{HomogeneousShape::Shape::kBox, shape.support().first, shape.support().second} {
  set_cells(cells, grid);
  const EmissionRamp& ramp = field.ramp();
  const size_t count = ramp.entries().size();
  for (int c = 0; c < 3; ++c) {
    for (const dvec3& entry : ramp.entries()) table[c].push_back(static_cast<float>(entry[c]));
    cells.colour[c] = table[c].data();
  }
  cells.lowest = static_cast<float>(ramp.lowest()), cells.scale = static_cast<float>(ramp.scale());
  cells.last = static_cast<float>(count - 1);
}

void lanes_emission(const EmissionCells& glow, PathStates& paths, const SlotList& rays, EmissionSegments& segments) {
  HWY_DYNAMIC_DISPATCH(Emission)(glow, paths, rays, segments);
}

}  // namespace brume
#endif
