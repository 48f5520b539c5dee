#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "volume/instance_search.cpp"
#include "volume/instance_search.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, InstanceNode::kWide>;
using V = hn::Vec<D>;

/// More than single precision rounds ray parameters, and, times the coordinates' size, faces by.
constexpr float kRounding = 1e-6f;
constexpr float kNearer = 1 - kRounding, kFarther = 1 + kRounding;

HWY_INLINE uint32_t bits_of(hn::Mask<D> mask) {
  uint8_t bits[8] = {};
  hn::StoreMaskBits(D(), mask, bits);
  return static_cast<uint32_t>(bits[0] | bits[1] << 8);
}

/// A ray against the boxes of a node.
class WideSlabs {
 public:
  HWY_INLINE explicit WideSlabs(const SearchRay& ray) {
    const auto pad = kRounding * static_cast<float>(ray.size);
    for (int a = 0; a < 3; ++a) {
      const auto along = static_cast<float>(ray.d[a]), o = static_cast<float>(ray.o[a]);
      inverse_[a] = std::abs(along) < 1e-30f ? std::copysign(1e30f, along) : 1 / along;
      const float outwards = std::copysign(pad, inverse_[a]);
      near_[a] = o + outwards;
      far_[a] = o - outwards;
      upper_[a] = std::signbit(inverse_[a]);
    }
  }
  /// @param t  gets where the ray comes into each box   @return  bits of those that it meets before `limit`
  HWY_INLINE uint32_t meets(const InstanceNode& node, float limit, float* t) const {
    const D d;
    uint32_t bits = 0;
    for (size_t k = 0; k < InstanceNode::kWide; k += hn::Lanes(d)) {
      V t0 = hn::Zero(d), t1 = hn::Set(d, limit);
      for (int a = 0; a < 3; ++a) {
        const V inverse = hn::Set(d, inverse_[a]);
        const V nearer = hn::Load(d, node.face[upper_[a]][a] + k), farther = hn::Load(d, node.face[!upper_[a]][a] + k);
        t0 = hn::Max(t0, (nearer - hn::Set(d, near_[a])) * inverse);
        t1 = hn::Min(t1, (farther - hn::Set(d, far_[a])) * inverse);
      }
      hn::Store(t0, d, t + k);
      bits |= bits_of(t0 * hn::Set(d, kNearer) <= t1 * hn::Set(d, kFarther)) << k;
    }
    return bits;
  }

 private:
  float near_[3], far_[3], inverse_[3];
  bool upper_[3];  // whether the ray comes in by the upper face
};

// More than nodes that wait at a time: fifteen of each of eight levels.
constexpr size_t kMostWaiting = 160;

/// Calls visit(place in the order of instances, t), which returns a new limit, the nearest nodes first.
template <class Visit>
HWY_INLINE void along_ray(std::span<const InstanceNode> nodes, const SearchRay& ray, float limit, const Visit& visit) {
  const WideSlabs slabs(ray);
  struct Waiting {
    uint32_t node;
    float t;
  };
  std::array<Waiting, kMostWaiting> stack;
  size_t waiting = 0;
  stack[waiting++] = {0, 0.0f};
  HWY_ALIGN float t[InstanceNode::kWide];
  while (waiting > 0) {
    const Waiting from = stack[--waiting];
    if (from.t * kNearer > limit * kFarther) continue;
    const InstanceNode& node = nodes[from.node];
    uint32_t bits = slabs.meets(node, limit, t);
    if (node.of_instances) {
      for (; bits; bits &= bits - 1) {
        const auto k = static_cast<size_t>(std::countr_zero(bits));
        limit = visit(node.first + k, t[k]);
      }
      continue;
    }
    for (const size_t own = waiting; bits; bits &= bits - 1) {
      const auto k = static_cast<uint32_t>(std::countr_zero(bits));
      size_t place = waiting++;  // the nearest last: it is looked at first
      for (; place > own && stack[place - 1].t < t[k]; --place) stack[place] = stack[place - 1];
      stack[place] = {node.first + k, t[k]};
    }
  }
}

void AlongRay(std::span<const InstanceNode> nodes, const SearchRay& ray, float limit,
              const std::function<void(size_t)>& visit) {
  along_ray(nodes, ray, limit, [&](size_t place, float) {
    visit(place);
    return limit;
  });
}

size_t Nearest(std::span<const InstanceNode> nodes, std::span<const uint32_t> order, const SearchRay& ray, float limit,
               const Instances::Met& after, std::span<Instances::Met> found) {
  size_t count = 0;
  along_ray(nodes, ray, limit, [&](size_t place, float t) {
    const Instances::Met met{t, order[place]};
    const bool full = count == found.size();
    if (after < met && !(full && found[count - 1] < met)) {
      size_t at = full ? count - 1 : count++;
      for (; at > 0 && met < found[at - 1]; --at) found[at] = found[at - 1];
      found[at] = met;
    }
    return count == found.size() ? std::min(limit, found[count - 1].t) : limit;
  });
  return count;
}

/// Bits of a node's boxes that overlap another one.
HWY_INLINE uint32_t overlapping(const InstanceNode& node, const vec3& lo, const vec3& hi) {
  const D d;
  uint32_t bits = 0;
  for (size_t k = 0; k < InstanceNode::kWide; k += hn::Lanes(d)) {
    auto meets = hn::FirstN(d, hn::Lanes(d));
    for (int a = 0; a < 3; ++a) {
      meets = hn::And(meets, hn::Load(d, node.face[0][a] + k) <= hn::Set(d, hi[a]));
      meets = hn::And(meets, hn::Load(d, node.face[1][a] + k) >= hn::Set(d, lo[a]));
    }
    bits |= bits_of(meets) << k;
  }
  return bits;
}

void InBox(std::span<const InstanceNode> nodes, const vec3& lo, const vec3& hi,
           const std::function<void(size_t)>& visit) {
  std::array<uint32_t, kMostWaiting> stack;
  size_t waiting = 0;
  stack[waiting++] = 0;
  while (waiting > 0) {
    const InstanceNode& node = nodes[stack[--waiting]];
    for (uint32_t bits = overlapping(node, lo, hi); bits; bits &= bits - 1) {
      const uint32_t found = node.first + static_cast<uint32_t>(std::countr_zero(bits));
      if (node.of_instances)
        visit(found);
      else
        stack[waiting++] = found;
    }
  }
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(AlongRay);
HWY_EXPORT(Nearest);
HWY_EXPORT(InBox);

void search_instances(std::span<const InstanceNode> nodes, const SearchRay& ray, float limit,
                      const std::function<void(size_t)>& visit) {
  HWY_DYNAMIC_DISPATCH(AlongRay)(nodes, ray, limit, visit);
}

size_t nearest_instances(std::span<const InstanceNode> nodes, std::span<const uint32_t> order, const SearchRay& ray,
                         float limit, const Instances::Met& after, std::span<Instances::Met> found) {
  return HWY_DYNAMIC_DISPATCH(Nearest)(nodes, order, ray, limit, after, found);
}

void search_instances(std::span<const InstanceNode> nodes, const vec3& lo, const vec3& hi,
                      const std::function<void(size_t)>& visit) {
  HWY_DYNAMIC_DISPATCH(InBox)(nodes, lo, hi, visit);
}

}  // namespace brume
#endif
