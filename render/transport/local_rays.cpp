#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/transport/local_rays.cpp"
#include "render/transport/local_rays.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cstring>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
// In double precision, and without fused multiply-add: with it, instruction sets would differ in the last bit.
using D = hn::CappedTag<double, 8>;
using DI = hn::RebindToSigned<D>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
using M = hn::Mask<D>;
constexpr size_t kMost = hn::MaxLanes(D());

struct V3 {
  V x, y, z;
};

/// Consecutive members of an array of structs of doubles.
class Members {
 public:
  /// @param index  of the first one, for each lane
  HWY_INLINE Members(const void* base, VI index) : base_(static_cast<const double*>(base)), index_(index) {}
  HWY_INLINE V operator[](size_t member) const { return hn::GatherIndex(D(), base_ + member, index_); }
  HWY_INLINE V3 vector(size_t first) const { return {(*this)[first], (*this)[first + 1], (*this)[first + 2]}; }

 private:
  const double* base_;
  VI index_;
};

HWY_INLINE V set(double x) {
  return hn::Set(D(), x);
}

/// A matrix of columns times a vector, summed from the first column on.
HWY_INLINE V3 times(const V3 (&m)[3], const V3& v) {
  const auto row = [&](V a, V b, V c) { return a * v.x + b * v.y + c * v.z; };
  return {row(m[0].x, m[1].x, m[2].x), row(m[0].y, m[1].y, m[2].y), row(m[0].z, m[1].z, m[2].z)};
}

/// Rays against the slab between two faces of a box.
struct Slab {
  double lo, hi;
  V o, d;
  M outside, misses;  // where rays begin; whether those never come inside

  HWY_INLINE Slab(double low, double high, V origin, V direction) : lo(low), hi(high), o(origin), d(direction) {
    const V zero = hn::Zero(D());
    const M below = o < set(lo);
    const M above = o > set(hi);
    outside = hn::Or(below, above);
    misses = hn::Or(hn::And(outside, along()), hn::Or(hn::AndNot(d > zero, below), hn::AndNot(d < zero, above)));
  }
  /// Whether rays never reach the faces.
  HWY_INLINE M along() const { return hn::Abs(d) < set(1e-300); }
  /// Narrows the ray parameters between which rays are inside.
  HWY_INLINE void clip(V& t0, V& t1) const {
    const V a = (set(lo) - o) / d, b = (set(hi) - o) / d;
    t0 = hn::IfThenElse(along(), t0, hn::Max(t0, hn::Min(a, b)));
    t1 = hn::IfThenElse(along(), t1, hn::Min(t1, hn::Max(a, b)));
  }
};

enum class Place { kOne, kBySlot, kInstance };

template <Place kPlace>
void enter(const LocalBox& box, const std::array<Ray, kPool>& rays, const std::array<double, kPool>& ends,
           const SlotList& slots, LocalRays& to, std::array<double, kPool>& begin, SlotList& inside) {
  const D d;
  const DI di;
  static_assert(sizeof(Ray) % sizeof(double) == 0 && sizeof(Placement::ToLocal) % sizeof(double) == 0);
  static_assert(sizeof(Instance) == 16 * sizeof(double));
  V3 matrix[3], offset;
  const auto set_frame = [&](const auto& frame) {
    for (size_t c = 0; c < 3; ++c) matrix[c] = frame(3 * c);
    offset = frame(9);
  };
  V unit = set(box.unit);
  if (kPlace == Place::kOne) {
    double f[12];
    std::memcpy(f, box.to_local, sizeof f);
    set_frame([&](size_t i) { return V3{set(f[i]), set(f[i + 1]), set(f[i + 2])}; });
  }
  HWY_ALIGN int64_t at[kMost];
  HWY_ALIGN double entry[kMost], result[7][kMost];
  for (size_t k = 0; k < slots.count; k += hn::Lanes(d)) {
    const size_t count = std::min(hn::Lanes(d), slots.count - k);
    for (size_t lane = 0; lane < hn::Lanes(d); ++lane) at[lane] = slots.slot[k + std::min(lane, count - 1)];
    const VI slot = hn::Load(di, at);
    const auto members = [&](const void* base, size_t size) {
      return Members(base, slot * hn::Set(di, static_cast<int64_t>(size / sizeof(double))));
    };
    const Members ray = members(rays.data(), sizeof(Ray));
    if constexpr (kPlace == Place::kBySlot) {
      const Members frame = members(box.to_local, sizeof(Placement::ToLocal));
      set_frame([&](size_t i) { return frame.vector(i); });
    }
    if constexpr (kPlace == Place::kInstance) {
      HWY_ALIGN int64_t number[kMost];
      for (size_t lane = 0; lane < hn::Lanes(d); ++lane) number[lane] = box.instance[at[lane]];
      const Members one(box.instances, hn::Load(di, number) * hn::Set(di, sizeof(Instance) / sizeof(double)));
      set_frame([&](size_t i) { return one.vector(i); });
      unit = set(box.unit) / one[12];
    }
    const V3 direction = times(matrix, ray.vector(3));
    V3 o = times(matrix, ray.vector(0));
    o = {o.x + offset.x, o.y + offset.y, o.z + offset.z};
    const Slab x(box.lo.x, box.hi.x, o.x, direction.x), y(box.lo.y, box.hi.y, o.y, direction.y),
        z(box.lo.z, box.hi.z, o.z, direction.z);
    const V end = members(ends.data(), sizeof(double))[0];
    V t0 = hn::Zero(d);
    M meets = hn::Not(hn::Or(x.misses, hn::Or(y.misses, z.misses)));
    const M approaches = hn::And(meets, hn::Or(x.outside, hn::Or(y.outside, z.outside)));
    if (!hn::AllFalse(d, approaches)) {
      V enters = t0, leaves = end;
      for (const Slab& slab : {x, y, z}) slab.clip(enters, leaves);
      t0 = hn::IfThenElseZero(approaches, enters);
      meets = hn::And(meets, hn::Or(hn::Not(approaches), enters < leaves));
    }
    meets = hn::And(meets, t0 < end);
    uint8_t bits[8] = {};
    hn::StoreMaskBits(d, meets, bits);
    uint32_t left = bits[0] & ((1u << count) - 1);
    if (left == 0) continue;
    const auto store = [&](V from, V along, double shift, size_t i) {
      hn::Store(from + t0 * along + set(shift), d, result[i]);
      hn::Store(along * unit, d, result[i + 3]);
    };
    store(o.x, direction.x, box.shift.x, 0);
    store(o.y, direction.y, box.shift.y, 1);
    store(o.z, direction.z, box.shift.z, 2);
    hn::Store(hn::Min((end - t0) / unit, set(1e30)), d, result[6]);
    hn::Store(t0, d, entry);
    Column<float>* const columns[] = {&to.o.x, &to.o.y, &to.o.z, &to.d.x, &to.d.y, &to.d.z, &to.end};
    for (; left; left &= left - 1) {
      const auto lane = static_cast<size_t>(std::countr_zero(left));
      const auto s = static_cast<size_t>(at[lane]);
      for (size_t i = 0; i < 7; ++i) (*columns[i])[s] = static_cast<float>(result[i][lane]);
      begin[s] = entry[lane];
      inside.push(s);
    }
  }
}

void EnterBox(const LocalBox& box, const std::array<Ray, kPool>& rays, const std::array<double, kPool>& ends,
              const SlotList& slots, LocalRays& to, std::array<double, kPool>& begin, SlotList& inside) {
  (box.instances ? enter<Place::kInstance>
   : box.by_slot ? enter<Place::kBySlot>
                 : enter<Place::kOne>)(box, rays, ends, slots, to, begin, inside);
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(EnterBox);

void enter_box(const LocalBox& box, const std::array<Ray, kPool>& rays, const std::array<double, kPool>& ends,
               const SlotList& slots, LocalRays& to, std::array<double, kPool>& begin, SlotList& inside) {
  HWY_DYNAMIC_DISPATCH(EnterBox)(box, rays, ends, slots, to, begin, inside);
}

}  // namespace brume
#endif
