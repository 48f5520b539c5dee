#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/transport/camera_layers.cpp"
#include "render/transport/camera_layers.h"

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
#include "render/transport/detail_noise.h"

/// The next rays of a list. @param more(lane, slot)  called for each of them
template <class More>
HWY_INLINE M load_rays(RayQueue& queue, CellWalk::Buffer& buffer, const PathStates& paths, More&& more) {
  return mask_of(queue.load([&](size_t lane, size_t s) {
    buffer.fetch(paths.flight, s, lane);
    more(lane, s);
  }));
}

void Surface(const LaneScene& scene, const PathStates& paths, const SlotList& rays, const CameraRayLayers& camera,
             IsosurfaceCrossings& crossings) {
  const D d;
  const DI di;
  const V zero = hn::Zero(d), one = set(1.0f), iso = set(scene.isosurface_density);
  RayQueue queue(rays);
  CellWalk walk(scene);
  HWY_ALIGN float t[RayQueue::kMost] = {}, outside[RayQueue::kMost], density[RayQueue::kMost];
  V length = one, before = zero, value = zero;
  uint32_t collided = 0, close = 0;  // lanes that have hit the surface, or may have crossed a corner of it unseen

  const auto finish = [&]() BRUME_INLINE_LAMBDA {
    hn::Store(walk.t, d, t);
    hn::Store(before, d, outside);
    hn::Store(value, d, density);
    queue.finished &= collided | close;
    queue.collect([&](size_t lane, size_t s) {
      if (collided >> lane & 1)
        crossings.add(s, outside[lane], t[lane], -1, density[lane]);
      else
        crossings.unsure.push(s);
    });
  };
  const auto load = [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA {
    const M fresh = load_rays(queue, buffer, paths, [&](size_t lane, size_t s) { t[lane] = camera.begin[s]; });
    const V begin = hn::Load(d, t);
    walk.load(buffer, fresh, begin);
    length = voxel_length(walk);
    before = hn::IfThenElse(fresh, begin, before);
    collided &= ~bits_of(fresh);
    close &= ~bits_of(fresh);
  };
  drive(queue, walk, scene.stop, finish, load, [&](M active) BRUME_INLINE_LAMBDA {
    const VI word = hn::GatherIndex(di, scene.isosurface_cell, walk.index(active));
    const M nothing = hn::RebindMask(d, word < 0);
    const CellWalk::Crossing crossing = walk.ahead(word, nothing);
    const M passes = hn::And(active, hn::Or(nothing, walk.t >= crossing.until));
    const M looks = hn::AndNot(passes, active);
    // In a voxel that can reach the isosurface's density the density is interpolated; from any other voxel the ray
    // steps as many voxels ahead as cannot reach it (distance field).
    const V3 q = walk.within(walk.at(walk.t));
    const V last = set(scene.cell - 1.0f);
    const auto index = [&](V p) { return hn::ConvertTo(di, hn::Min(p, last)); };
    const VI size = hn::Set(di, scene.stored - 1), brick = hn::IfThenElseZero(hn::RebindMask(di, looks), word);
    const VI voxel = (index(q.x) * size + index(q.y)) * size + index(q.z);
    const VI byte = brick * (size * (size * size)) + voxel;
    const VI bytes = hn::GatherOffset(di, reinterpret_cast<const int32_t*>(scene.distances),
                                      hn::IfThenElseZero(hn::RebindMask(di, looks), byte));
    const V distance = hn::ConvertTo(d, hn::And(bytes, hn::Set(di, 255)));
    const M near = hn::And(looks, distance == zero);
    M hit = hn::FirstN(d, 0);
    if (!hn::AllFalse(d, near)) {
      const VI stored = hn::Set(di, scene.stored);
      const VI values = hn::IfThenElseZero(hn::RebindMask(di, near), brick) * (stored * (stored * stored));
      const V looked_up = interpolated(scene, values, q);
      hit = hn::And(near, looked_up >= iso);
      value = hn::IfThenElse(hit, looked_up, value);
      collided |= bits_of(hit);
    }
    const M moves = hn::AndNot(hit, looks);
    const V next = hn::Min(walk.t + hn::Max(distance, one) * length, crossing.until);
    // Between two samples a ray can cross the corner of a voxel that reaches the density: where a sample lies in an
    // adjacent voxel, or the step ends at the cell's face.
    const M corner =
        hn::Or(distance <= one, hn::And(next >= crossing.until, crossing.until - walk.t > (distance - one) * length));
    close |= bits_of(hn::And(moves, corner));
    const V reached = hn::IfThenElse(passes, crossing.until, hn::Max(walk.t, next - length));
    before = hn::IfThenElse(hn::Or(moves, hn::And(passes, nothing)), reached, before);
    const M left = walk.cross(crossing, hn::Or(passes, hn::And(moves, next >= crossing.until)));
    walk.t = hn::IfThenElse(moves, next, walk.t);
    queue.end(hn::Or(hit, left));
  });
}

void DisplacedSurface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                      IsosurfaceCrossings& crossings) {
  const D d;
  const V zero = hn::Zero(d), iso = set(scene.isosurface_density);
  RayQueue queue(rays);
  CellWalk walk(scene);
  HWY_ALIGN float times[RayQueue::kMost] = {}, inside[RayQueue::kMost], outside[RayQueue::kMost],
                  above[RayQueue::kMost];
  V step = set(1.0f), time = zero, before = zero, value = zero;
  uint32_t collided = 0;

  const auto finish = [&]() BRUME_INLINE_LAMBDA {
    hn::Store(walk.t, d, inside);
    hn::Store(before, d, outside);
    hn::Store(value, d, above);
    queue.finished &= collided;
    queue.collect([&](size_t lane, size_t s) { crossings.add(s, outside[lane], inside[lane], -1, above[lane]); });
  };
  const auto load = [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA {
    const M fresh =
        load_rays(queue, buffer, paths, [&](size_t lane, size_t s) { times[lane] = frame_of(scene, paths, s); });
    walk.load(buffer, fresh);
    step = 0.25f * voxel_length(walk);
    time = hn::Load(d, times);
    before = hn::IfThenElse(fresh, zero, before);
    collided &= ~bits_of(fresh);
  };
  drive(queue, walk, scene.stop, finish, load, [&](M active) BRUME_INLINE_LAMBDA {
    const V bound = hn::GatherIndex(d, scene.majorant, walk.index(active));
    const CellWalk::Crossing crossing = walk.ahead(hn::BitCast(DI(), bound), bound < zero);
    const M low = bound < iso, passes = hn::And(active, hn::Or(low, walk.t >= crossing.until));
    const M looks = hn::AndNot(passes, active);
    M hit = hn::FirstN(d, 0);
    if (!hn::AllFalse(d, looks)) {
      const V looked_up = displaced_density(scene, walk.at(walk.t), time);
      hit = hn::And(looks, looked_up >= iso);
      value = hn::IfThenElse(hit, looked_up, value);
    }
    collided |= bits_of(hit);
    const M moves = hn::AndNot(hit, looks);
    before = hn::IfThenElse(moves, walk.t, hn::IfThenElse(hn::And(passes, low), crossing.until, before));
    const V next = hn::Min(walk.t + step, crossing.until);
    const M left = walk.cross(crossing, hn::Or(passes, hn::And(moves, next >= crossing.until)));
    walk.t = hn::IfThenElse(moves, next, walk.t);
    queue.end(hn::Or(hit, left));
  });
}

/// The density of a scene's grid at points, displaced where it is. @param time  in frames
template <bool kMoved>
HWY_INLINE V density_of(const LaneScene& scene, const V3& p, V time) {
  if constexpr (kMoved)
    return displaced_density(scene, p, time);
  else
    return density_at(scene, p);
}

/// The times of the paths in slots, in frames; 0 where nothing is displaced.
template <bool kMoved>
HWY_INLINE V frames_of(const LaneScene& scene, const PathStates& paths, VI slot) {
  if (!kMoved) return hn::Zero(D());
  return hn::MulAdd(set(scene.close - scene.open), hn::GatherIndex(D(), paths.time.data(), slot), set(scene.open));
}

template <bool kMoved>
void isosurface_points(const LaneScene& scene, const PathStates& paths, IsosurfaceCrossings& crossings,
                       GradientPoints& points) {
  const D d;
  const DI di;
  const V iso = set(scene.isosurface_density);
  SlotList& slots = crossings.slots;
  slots.pad();
  points.slots.count = slots.count;
  for (size_t i = 0; i < slots.count; i += hn::Lanes(d)) {
    const VI slot = hn::LoadU(di, slots.slot.data() + i);
    hn::StoreU(slot, di, points.slots.slot.data() + i);
    const V3 o = gather3(paths.flight.o, slot), dir = gather3(paths.flight.d, slot);
    const auto along = [&](V by) { return o + dir * by; };
    const V time = frames_of<kMoved>(scene, paths, slot);
    const auto root = [](V v) { return hn::Sqrt(hn::Max(v, hn::Zero(D()))); };
    // In the half that holds the surface, where a straight line through the roots of the densities puts it. At its edge
    // a medium begins more like a square than like a line.
    V begin = hn::LoadU(d, crossings.outside.data() + i), end = hn::LoadU(d, crossings.inside.data() + i);
    V below = hn::LoadU(d, crossings.below.data() + i), above = hn::LoadU(d, crossings.above.data() + i);
    const M unknown = below < 0.0f;
    if (!hn::AllFalse(d, unknown))
      below = hn::IfThenElse(unknown, hn::Min(density_of<kMoved>(scene, along(begin), time), iso), below);
    const V middle = 0.5f * (begin + end), there = density_of<kMoved>(scene, along(middle), time);
    const M nearer = there >= iso;
    end = hn::IfThenElse(nearer, middle, end);
    above = root(hn::IfThenElse(nearer, there, above));
    begin = hn::IfThenElse(nearer, begin, middle);
    below = root(hn::IfThenElse(nearer, below, there));
    const V share = (root(iso) - below) / hn::Max(above - below, set(1e-30f));
    const V surface = begin + (end - begin) * hn::Min(share, set(1.0f));
    const V3 p = along(surface + 0.5f / length(dir));
    store3(p, points.p, i);
  }
}

void SurfacePoints(const LaneScene& scene, const PathStates& paths, IsosurfaceCrossings& crossings,
                   GradientPoints& points) {
  (scene.displaced ? isosurface_points<true> : isosurface_points<false>)(scene, paths, crossings, points);
}

template <bool kMoved>
void march(const LaneScene& scene, const PathStates& paths, const SlotList& rays, CameraRayLayers& camera) {
  const D d;
  const V zero = hn::Zero(d), one = set(1.0f), deepest = set(static_cast<float>(kDeepest));
  RayQueue queue(rays);
  CellWalk walk(scene);
  GeneratorBuffer generators;
  Generator rng = generators.load();
  HWY_ALIGN Lanes times = {};
  V length = one, time = zero, offset = zero, depth = zero, level[kMarchedPoints], point[kMarchedPoints];
  for (size_t k = 0; k < kMarchedPoints; ++k) level[k] = point[k] = zero;

  const auto finish = [&]() BRUME_INLINE_LAMBDA {
    HWY_ALIGN float depths[RayQueue::kMost], points[kMarchedPoints][RayQueue::kMost];
    hn::Store(depth, d, depths);
    for (size_t k = 0; k < kMarchedPoints; ++k) hn::Store(point[k], d, points[k]);
    queue.collect([&](size_t lane, size_t s) {
      camera.depth[s] = depths[lane];
      for (size_t k = 0; k < kMarchedPoints; ++k) camera.point[k][s] = points[k][lane];
    });
  };
  const auto load = [&](CellWalk::Buffer& buffer) BRUME_INLINE_LAMBDA {
    generators.store(rng);
    const M fresh = load_rays(queue, buffer, paths, [&](size_t lane, size_t s) {
      generators.fetch(paths, s, lane);
      if (kMoved) times[lane] = frame_of(scene, paths, s);
    });
    walk.load(buffer, fresh);
    rng = generators.load();
    length = voxel_length(walk);
    if (kMoved) time = hn::Load(d, times);
    depth = hn::IfThenElse(fresh, zero, depth);
    offset = hn::IfThenElse(fresh, rng.uniform(fresh), offset);
    const V u = rng.uniform(fresh);
    for (size_t k = 0; k < kMarchedPoints; ++k) {
      const V v = (u + static_cast<float>(k)) * (1.0f / kMarchedPoints);
      level[k] = hn::IfThenElse(fresh, -log_of(one - v), level[k]);
      point[k] = hn::IfThenElse(fresh, set(-1.0f), point[k]);
    }
  };
  drive(queue, walk, scene.stop, finish, load, [&](M active) BRUME_INLINE_LAMBDA {
    const auto [cell_index, crossing, passes, looks] = walk.look(active);
    M done = walk.cross(crossing, passes);

    const V t0 = walk.t, t1 = hn::Min(t0 + length, crossing.until), part = t1 - t0;
    const V3 p = walk.at(t0 + offset * part);
    V value = zero;
    V3 stored = p;
    if constexpr (kMoved) {
      stored = stored_at(scene, p, time);
      value = density_at(scene.density, stored);
    } else {
      value = one_voxel(walk, rng, p, brick_of(scene, cell_index, looks), looks);
    }
    if (scene.detail.octaves > 0) value = with_detail(scene.detail, stored, value, rng, looks);
    const V sigma = hn::IfThenElseZero(looks, value * scene.sigma);
    const V after = depth + sigma * part;
    for (size_t k = 0; k < kMarchedPoints; ++k) {
      const M passed = hn::And(depth < level[k], after >= level[k]);
      const V where = t0 + (level[k] - depth) / hn::Max(sigma, set(1e-30f));
      point[k] = hn::IfThenElse(passed, where, point[k]);
    }
    depth = hn::Min(after, deepest);
    walk.t = hn::IfThenElse(looks, t1, t0);
    queue.end(hn::Or(done, hn::And(looks, depth >= deepest)));
  });
}

void March(const LaneScene& scene, const PathStates& paths, const SlotList& rays, CameraRayLayers& camera) {
  (scene.displaced ? march<true> : march<false>)(scene, paths, rays, camera);
}

template <bool kMoved>
void gradient(const LaneScene& scene, const PathStates& paths, GradientPoints& points) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  for (auto* column : {&points.p.x, &points.p.y, &points.p.z})
    std::fill_n(column->begin() + static_cast<std::ptrdiff_t>(points.slots.count), lanes, 0.0f);
  points.slots.pad();
  for (size_t i = 0; i < points.slots.count; i += lanes) {
    V3 p = load3(points.p, i);
    if (kMoved) p = stored_at(scene, p, frames_of<kMoved>(scene, paths, hn::LoadU(DI(), points.slots.slot.data() + i)));
    const LaneCells& cells = kMoved ? scene.density : scene;
    const V zero = hn::Zero(d), one = set(1.0f);
    const auto difference = [&](const V3& step) {
      return 0.5f * (density_at(cells, p + step) - density_at(cells, p - step));
    };
    const V3 g{difference({one, zero, zero}), difference({zero, one, zero}), difference({zero, zero, one})};
    const M clear = length(g) >= scene.least_gradient;
    const V3 world = transform(scene.gradient_to_world, g);
    store3(world * hn::IfThenElseZero(clear, 1.0f / length(world)), points.gradient, i);
  }
}

void Gradient(const LaneScene& scene, const PathStates& paths, GradientPoints& points) {
  (scene.displaced ? gradient<true> : gradient<false>)(scene, paths, points);
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(Surface);
HWY_EXPORT(DisplacedSurface);
HWY_EXPORT(SurfacePoints);
HWY_EXPORT(March);
HWY_EXPORT(Gradient);

void lanes_find_isosurface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                           const CameraRayLayers& camera, IsosurfaceCrossings& crossings) {
  HWY_DYNAMIC_DISPATCH(Surface)(scene, paths, rays, camera, crossings);
}

void lanes_find_displaced_isosurface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                                     IsosurfaceCrossings& crossings) {
  HWY_DYNAMIC_DISPATCH(DisplacedSurface)(scene, paths, rays, crossings);
}

void lanes_isosurface_points(const LaneScene& scene, const PathStates& paths, IsosurfaceCrossings& crossings,
                             GradientPoints& points) {
  HWY_DYNAMIC_DISPATCH(SurfacePoints)(scene, paths, crossings, points);
}

void lanes_march(const LaneScene& scene, const PathStates& paths, const SlotList& rays, CameraRayLayers& camera) {
  HWY_DYNAMIC_DISPATCH(March)(scene, paths, rays, camera);
}

void lanes_gradient(const LaneScene& scene, const PathStates& paths, GradientPoints& points) {
  HWY_DYNAMIC_DISPATCH(Gradient)(scene, paths, points);
}

}  // namespace brume
#endif
