#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/transport/ray_packet.cpp"
#include "render/transport/ray_packet.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <span>

#include "volume/lane_grid.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/cell_walk.h"

/// A vector of rays, in local coordinates whose first axis is the packet's main axis.
struct PacketRays {
  V3 o, d;
  V inverse;                   // of the first axis
  V exit;                      // ray parameter where they leave the grid through a side
  V before, below;             // the last sample's ray parameter, and its density
  uint32_t busy = 0, met = 0;  // active lanes; those that have hit the surface
  HWY_ALIGN int32_t slot[RayQueue::kMost];

  HWY_INLINE V3 at(V t) const { return o + d * t; }
  /// Where they cross a plane perpendicular to the first axis, even if that is before their origins.
  HWY_INLINE V crosses(float plane) const { return (plane - o.x) * inverse; }
};

/// Marches the rays of a pixel through the layers of voxels together. They are so close to each other that the values
/// around all of them are loaded at once: 4 x 4 corners of voxels for each plane that they cross.
class PacketWalk {
 public:
  static constexpr size_t kVectors = 4;

  PacketWalk(const LaneScene& scene, int axis)
      : scene_(scene),
        axes_{axis, (axis + 1) % 3, (axis + 2) % 3},
        cell_(scene.stored - 1),
        cell_bits_(std::countr_zero(static_cast<unsigned>(cell_))) {
    const int nx = static_cast<int>(scene.nx), ny = static_cast<int>(scene.ny), nz = scene.nz_int;
    const int cells[3] = {nx, ny, nz}, cell_strides[3] = {ny * nz, nz, 1};
    const int strides[3] = {scene.stored * scene.stored, scene.stored, 1};
    for (int k = 0; k < 3; ++k) {
      cells_[k] = cells[axes_[k]];
      cell_stride_[k] = cell_strides[axes_[k]];
      stride_[k] = strides[axes_[k]];
    }
  }

  /// Marches at most kVectors vectors of rays from a layer on. The result of a ray does not depend on the others.
  void walk(const PathStates& paths, const int32_t* slots, size_t count, int first, IsosurfaceCrossings& crossings) {
    load_rays(paths, slots, count);
    const int step = hn::GetLane(rays_[0].d.x) < 0 ? -1 : 1, layers = cells_[0] * cell_;
    bool known = false;  // whether the last samples lie on the layer's near plane
    bool close = false;  // whether a window held a voxel that can reach the isosurface's density
    begun_ = false;
    for (int k = first; k >= 0 && k < layers && busy(); k += step) {
      const int near = step > 0 ? k : k + 1, far = step > 0 ? k + 1 : k;
      // Cells that cannot reach the isosurface's density are skipped whole.
      if (!known && (k == first || (near & (cell_ - 1)) == 0)) {
        const int end = step > 0 ? (k | (cell_ - 1)) + 1 : k & ~(cell_ - 1);
        if (!cells_reach(k, near, end)) {
          k = end - (step > 0);
          continue;
        }
      }
      const Window& at_middle = window(0, k, lowest(static_cast<float>(k) + 0.5f));
      const Window& at_far = window(1, k, lowest(static_cast<float>(far)));
      begun_ = begun_ || all_begin_before(static_cast<float>(near));
      const bool reached = !begun_ || reaches(at_middle) || reaches(at_far);
      if (reached) {
        const Window* const at_near = known ? nullptr : &window(2, k, lowest(static_cast<float>(near)));
        for (size_t r = 0; r < vectors_; ++r)
          if (rays_[r].busy) look_through(rays_[r], k, near, far, at_near, at_middle, at_far, crossings);
      }
      known = reached;
      close = close || reached;
    }
    if (!close) return;
    const size_t lanes = hn::Lanes(D());
    for (size_t i = 0; i < count; ++i)
      if (!(rays_[i / lanes].met >> i % lanes & 1)) crossings.unsure.push(static_cast<size_t>(slots[i]));
  }

 private:
  static constexpr int kWindow = LaneGrid::kPacketVoxels + 1;  // corners in a row
  static constexpr int kCorners = kWindow * kWindow;

  /// Values at corners of voxels, in the two planes of a layer, the lower one first.
  struct Window {
    int layer = -1;
    ivec2 corner{0};  // the lowest one
    HWY_ALIGN float values[2][kCorners];
  };

  void load_rays(const PathStates& paths, const int32_t* slots, size_t count) {
    const D d;
    const size_t lanes = hn::Lanes(d);
    const auto columns = [](const Column3& c) { return std::array{c.x.data(), c.y.data(), c.z.data()}; };
    const std::array o = columns(paths.flight.o), along = columns(paths.flight.d);
    vectors_ = (count + lanes - 1) / lanes;
    for (size_t r = 0; r < vectors_; ++r) {
      PacketRays& rays = rays_[r];
      const size_t left = count - r * lanes;  // the rest of the last vector: its last ray
      for (size_t i = 0; i < lanes; ++i) rays.slot[i] = slots[r * lanes + std::min(i, left - 1)];
      const VI slot = hn::Load(DI(), rays.slot);
      const auto get = [&](const auto& by_axis) {
        return V3{hn::GatherIndex(d, by_axis[axes_[0]], slot), hn::GatherIndex(d, by_axis[axes_[1]], slot),
                  hn::GatherIndex(d, by_axis[axes_[2]], slot)};
      };
      rays.o = get(o);
      rays.d = get(along);
      rays.inverse = 1.0f / rays.d.x;
      const auto leaves = [&](V from, V speed, int cells) {
        const V side = hn::IfThenElseZero(speed > 0.0f, set(static_cast<float>(cells * cell_)));
        return hn::IfThenElse(hn::Abs(speed) < 1e-12f, set(1e30f), (side - from) / speed);
      };
      rays.exit = hn::Min(leaves(rays.o.y, rays.d.y, cells_[1]), leaves(rays.o.z, rays.d.z, cells_[2]));
      rays.before = rays.below = hn::Zero(d);
      rays.busy = bits_of(hn::FirstN(d, left));
      rays.met = 0;
    }
  }

  bool busy() const {
    return std::any_of(rays_, rays_ + vectors_, [](const PacketRays& rays) { return rays.busy != 0; });
  }

  bool all_begin_before(float plane) const {
    return std::all_of(rays_, rays_ + vectors_,
                       [&](const PacketRays& rays) { return (rays.busy & bits_of(rays.crosses(plane) <= 0.0f)) == 0; });
  }

  /// The lowest coordinates, on the two other axes, of the voxels in which rays cross a plane.
  HWY_INLINE ivec2 lowest(float plane) const {
    const D d;
    V y = set(1e30f), z = set(1e30f);
    for (size_t r = 0; r < vectors_; ++r) {
      const V3 p = rays_[r].at(rays_[r].crosses(plane));
      const M busy = mask_of(rays_[r].busy);
      y = hn::IfThenElse(busy, hn::Min(y, p.y), y);
      z = hn::IfThenElse(busy, hn::Min(z, p.z), z);
    }
    const auto floored = [&](V v) { return static_cast<int>(std::floor(hn::GetLane(hn::MinOfLanes(d, v)))); };
    return {floored(y), floored(z)};
  }

  /// Whether the isosurface's density may be reached between two planes in the cells that hold layer k.
  bool cells_reach(int k, int near, int end) const {
    const ivec2 low = glm::min(lowest(static_cast<float>(near)), lowest(static_cast<float>(end))) >> cell_bits_;
    for (int i = 0; i < kWindow; ++i)
      for (int j = 0; j < kWindow; ++j) {
        const int y = std::clamp(low.x + i, 0, cells_[1] - 1), z = std::clamp(low.y + j, 0, cells_[2] - 1);
        if (scene_.isosurface_cell[(k >> cell_bits_) * cell_stride_[0] + y * cell_stride_[1] + z * cell_stride_[2]] >=
            0)
          return true;
      }
    return false;
  }

  /// A window in layer k; one of the first `number` windows where that is the same.
  HWY_INLINE const Window& window(size_t number, int k, const ivec2& corner) {
    for (size_t i = 0; i < number; ++i)
      if (windows_[i].layer == k && windows_[i].corner == corner) return windows_[i];
    const D d;
    const DI di;
    Window& w = windows_[number];
    w.layer = k;
    w.corner = corner;
    for (size_t i = 0; i < kCorners; i += hn::Lanes(d)) {
      const VI n = hn::Iota(di, static_cast<int32_t>(i));
      VI cell = hn::Set(di, (k >> cell_bits_) * cell_stride_[0]), value = hn::Set(di, (k & (cell_ - 1)) * stride_[0]);
      const auto add = [&](VI offset, int from, int axis) {
        const int cells = cells_[axis];  // no ray samples outside the grid: clamped
        const VI at = hn::Min(hn::Max(offset + from, hn::Zero(di)), hn::Set(di, cells * cell_));
        const VI c = hn::Min(hn::ShiftRightSame(at, cell_bits_), hn::Set(di, cells - 1));
        cell = cell + c * cell_stride_[axis];
        value = value + (at - hn::ShiftLeftSame(c, cell_bits_)) * stride_[axis];
      };
      static_assert(kWindow == 4);
      add(hn::ShiftRight<2>(n), corner.x, 1);
      add(hn::And(n, hn::Set(di, kWindow - 1)), corner.y, 2);
      const VI brick = hn::GatherIndex(di, scene_.brick, cell);
      const auto empty = brick < 0;
      const VI index = hn::IfThenZeroElse(empty, brick + value);
      for (const int plane : {0, 1}) {
        const V values = hn::GatherIndex(d, scene_.values + plane * stride_[0], index);
        hn::Store(hn::IfThenZeroElse(hn::RebindMask(d, empty), values), d, w.values[plane] + i);
      }
    }
    return w;
  }

  /// Whether a voxel of a window can reach the isosurface's density, with some room for rounding.
  HWY_INLINE bool reaches(const Window& w) const {
    const D d;
    V most = hn::Zero(d);
    for (size_t i = 0; i < kCorners; i += hn::Lanes(d))
      most = hn::Max(most, hn::Max(hn::Load(d, w.values[0] + i), hn::Load(d, w.values[1] + i)));
    return !hn::AllFalse(d, most >= scene_.isosurface_density * (1 - 1e-6f));
  }

  /// Positions in a window: the lower corner's index, and the interpolation weights.
  struct Spot {
    VI corner;
    V y, z;
  };
  HWY_INLINE Spot spot(const Window& w, const V3& p) const {
    // The weights are fractions of absolute coordinates: rounded the same wherever the window lies.
    const auto voxel = [](V v, int corner) {
      const V low = set(static_cast<float>(corner)), high = set(static_cast<float>(corner + kWindow - 2));
      return hn::Min(hn::Max(hn::Floor(v), low), high);
    };
    const V y = voxel(p.y, w.corner.x), z = voxel(p.z, w.corner.y);
    const V corner = (y - w.corner.x) * kWindow + (z - w.corner.y);
    return {hn::ConvertTo(DI(), corner), p.y - y, p.z - z};
  }
  HWY_INLINE V on_plane(const float* values, const Spot& s) const {
    const auto corner = [&](int offset) {
      const VI index = s.corner + offset;
      if constexpr (RayQueue::kMost == kCorners)
        return hn::TableLookupLanes(hn::Load(D(), values), hn::IndicesFromVec(D(), index));
      else
        return hn::GatherIndex(D(), values, index);
    };
    return lerp(lerp(corner(0), corner(1), s.z), lerp(corner(kWindow), corner(kWindow + 1), s.z), s.y);
  }

  /// Samples the density at the near plane of layer k unless that is known, half-way through the layer and at the far
  /// plane.
  HWY_INLINE void look_through(PacketRays& rays, int k, int near, int far, const Window* at_near,
                               const Window& at_middle, const Window& at_far, IsosurfaceCrossings& crossings) const {
    const V zero = hn::Zero(D());
    const V t0 = rays.crosses(static_cast<float>(near)), t1 = rays.crosses(static_cast<float>(far));
    const V begin = hn::Max(t0, zero);
    // Rays whose origins lie inside the layer do not start at a plane.
    const M begins = hn::And(t0 <= zero, t1 > zero);
    const V middle = hn::IfThenElse(begins, 0.5f * t1, rays.crosses(static_cast<float>(k) + 0.5f));
    const bool any_begins = !begun_ && !hn::AllFalse(D(), begins);
    const auto anywhere = [&](V t, V otherwise) {
      return any_begins ? hn::IfThenElse(begins, density_at(scene_, on_grid_axes(rays.at(t))), otherwise) : otherwise;
    };
    const auto in_plane = [&](const Window& w, int plane, V t) {
      return on_plane(w.values[plane - k], spot(w, rays.at(t)));
    };
    const M all = hn::FirstN(D(), hn::Lanes(D()));
    if (at_near)
      look(rays, all, begin, t1, anywhere(begin, in_plane(*at_near, near, begin)), crossings);
    else if (any_begins)
      look(rays, begins, begin, t1, anywhere(begin, zero), crossings);
    const Spot s = spot(at_middle, rays.at(middle));
    const V between = lerp(on_plane(at_middle.values[0], s), on_plane(at_middle.values[1], s), set(0.5f));
    look(rays, all, middle, t1, anywhere(middle, between), crossings);
    look(rays, all, t1, t1, in_plane(at_far, far, t1), crossings);
  }
  HWY_INLINE V3 on_grid_axes(const V3& p) const {
    const V by_axis[3] = {p.x, p.y, p.z};
    // axes_ is a cyclic permutation of x, y, z; this is its inverse.
    return {by_axis[(3 - axes_[0]) % 3], by_axis[(4 - axes_[0]) % 3], by_axis[(5 - axes_[0]) % 3]};
  }

  /// Takes a sample of the density along some of the rays: those above the isosurface's density have hit it.
  /// @param until  ray parameter of the end of the layer
  HWY_INLINE void look(PacketRays& rays, M some, V t, V until, V density, IsosurfaceCrossings& crossings) const {
    const D d;
    const M inside = hn::And(t <= rays.exit, until > 0.0f);
    const V value = hn::IfThenElseZero(inside, density);
    const M hits = hn::And(hn::And(mask_of(rays.busy), some), value >= scene_.isosurface_density);
    if (!hn::AllFalse(d, hits)) {
      // Compressed in registers: to memory that is slow on some processors.
      const size_t k = crossings.slots.count;
      const auto add = [&](V v, auto& column) { hn::StoreU(hn::Compress(v, hits), d, column.data() + k); };
      add(rays.before, crossings.outside);
      add(rays.below, crossings.below);
      add(t, crossings.inside);
      add(value, crossings.above);
      const VI slots = hn::Compress(hn::Load(DI(), rays.slot), hn::RebindMask(DI(), hits));
      hn::StoreU(slots, DI(), crossings.slots.slot.data() + k);
      crossings.slots.count += hn::CountTrue(d, hits);
    }
    rays.before = hn::IfThenElse(some, t, rays.before);
    rays.below = hn::IfThenElse(some, value, rays.below);
    rays.met |= bits_of(hits);
    rays.busy &= ~(bits_of(hits) | bits_of(t >= rays.exit));
  }

  const LaneScene& scene_;
  int axes_[3];
  int cell_, cell_bits_;
  int cells_[3], cell_stride_[3], stride_[3];  // on those axes
  size_t vectors_ = 0;
  bool begun_ = false;  // whether all rays begin before the layer
  PacketRays rays_[kVectors];
  Window windows_[3];
};

void SurfaceOfPackets(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                      std::span<const RayPacket> packets, IsosurfaceCrossings& crossings) {
  const size_t most = PacketWalk::kVectors * hn::Lanes(D());
  for (const RayPacket& b : packets) {
    PacketWalk packet(scene, b.axis);
    for (size_t begin = b.begin; begin < b.end; begin += most)
      packet.walk(paths, rays.slot.data() + begin, std::min(most, b.end - begin), b.layer, crossings);
  }
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(SurfaceOfPackets);

void lanes_find_isosurface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                           std::span<const RayPacket> packets, IsosurfaceCrossings& crossings) {
  HWY_DYNAMIC_DISPATCH(SurfaceOfPackets)(scene, paths, rays, packets, crossings);
}

}  // namespace brume
#endif
