#include "volume/instances.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace brume {
namespace {

// Of four or more each quarter holds at least one.
constexpr size_t kMostInLeaf = 3;
// Where there are fewer, a box that no scene reaches.
const vec3 kNowhere(1e30f, 2e30f, -3e30f);

/// A world box in single precision around an instance's local one.
std::pair<vec3, vec3> box_around(const dmat3& world_from_local, const dvec3& offset, const dvec3& lo, const dvec3& hi) {
  dvec3 from(std::numeric_limits<double>::infinity()), to = -from;
  for (int k = 0; k < 8; ++k) {
    const dvec3 corner{k & 1 ? hi.x : lo.x, k & 2 ? hi.y : lo.y, k & 4 ? hi.z : lo.z};
    const dvec3 p = world_from_local * (corner - offset);
    from = glm::min(from, p);
    to = glm::max(to, p);
  }
  constexpr float kEnd = std::numeric_limits<float>::infinity();
  std::pair<vec3, vec3> box;
  for (int a = 0; a < 3; ++a) {
    // Twice: the numbers above are rounded, too.
    box.first[a] = std::nextafter(std::nextafter(static_cast<float>(from[a]), -kEnd), -kEnd);
    box.second[a] = std::nextafter(std::nextafter(static_cast<float>(to[a]), kEnd), kEnd);
  }
  return box;
}

}  // namespace

Instances::Instances(std::vector<Instance> all, const dvec3& lo, const dvec3& hi)
    : all_(std::move(all)), local_lo_(lo), local_hi_(hi) {
  std::vector<std::pair<vec3, vec3>> boxes;
  boxes.reserve(all_.size());
  double thickest = -1;
  for (size_t i = 0; i < all_.size(); ++i) {
    const Instance& one = all_[i];
    const dmat3 world_from_local = glm::inverse(one.to_local.matrix);
    boxes.push_back(box_around(world_from_local, one.to_local.offset, lo, hi));
    const dvec3 edges(glm::length(world_from_local[0]), glm::length(world_from_local[1]),
                      glm::length(world_from_local[2]));
    voxel_size_ += -max_component(-edges) / static_cast<double>(all_.size());
    if (const double depth = one.density * max_component(edges); depth > thickest) thickest = depth, thickest_ = i;
    tinted_ = tinted_ || one.tint != dvec3(1);
    order_.push_back(static_cast<uint32_t>(i));
  }
  lo_ = dvec3(std::numeric_limits<double>::infinity());
  hi_ = -lo_;
  for (const auto& [from, to] : boxes) {
    lo_ = glm::min(lo_, dvec3(from));
    hi_ = glm::max(hi_, dvec3(to));
  }
  build(0, all_.size(), boxes);
  list_neighbours(boxes);
}

/// Puts the half with the smaller middles on the widest axis first. @return  where the other half begins
size_t Instances::halve(size_t begin, size_t end, const Boxes& boxes) {
  vec3 least(std::numeric_limits<float>::infinity()), most = -least;
  const auto middle = [&](uint32_t i) { return boxes[i].first + boxes[i].second; };
  for (size_t k = begin; k < end; ++k) {
    least = glm::min(least, middle(order_[k]));
    most = glm::max(most, middle(order_[k]));
  }
  const vec3 extent = most - least;
  const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
  const size_t half = begin + (end - begin) / 2;
  const auto at = [&](size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
  std::nth_element(at(begin), at(half), at(end), [&](uint32_t a, uint32_t b) {
    const float x = middle(a)[axis], y = middle(b)[axis];
    return x < y || (x == y && a < b);
  });
  return half;
}

uint32_t Instances::build(size_t begin, size_t end, const Boxes& boxes) {
  const auto number = static_cast<uint32_t>(nodes_.size());
  nodes_.emplace_back();
  std::array<size_t, kWide + 1> parts{begin, begin, begin, begin, end};
  if (end - begin > kMostInLeaf) {
    parts[2] = halve(begin, end, boxes);
    parts[1] = halve(begin, parts[2], boxes);
    parts[3] = halve(parts[2], end, boxes);
  }
  for (size_t k = 0; k < kWide; ++k) {
    vec3 lo(std::numeric_limits<float>::infinity()), hi = -lo;
    for (size_t i = parts[k]; i < parts[k + 1]; ++i) {
      lo = glm::min(lo, boxes[order_[i]].first);
      hi = glm::max(hi, boxes[order_[i]].second);
    }
    if (parts[k] == parts[k + 1]) lo = hi = kNowhere;
    const size_t count = std::max<size_t>(parts[k + 1] - parts[k], 1);
    const uint32_t first = count > kMostInLeaf ? build(parts[k], parts[k + 1], boxes) : static_cast<uint32_t>(parts[k]);
    Node& node = nodes_[number];
    node.first[k] = first;
    node.count[k] = count > kMostInLeaf ? 0 : static_cast<uint32_t>(count);
    for (int a = 0; a < 3; ++a) node.lo[a][k] = lo[a], node.hi[a][k] = hi[a];
  }
  return number;
}

void Instances::list_neighbours(const Boxes& boxes) {
  for (size_t i = 0; i < all_.size(); ++i) {
    Around& own = around_.emplace_back(Around{static_cast<uint32_t>(listed_.size()), 0});
    const dvec3 lo(boxes[i].first), hi(boxes[i].second);
    each_near(lo, hi, [&](size_t k) {
      const bool overlap = glm::all(glm::lessThanEqual(dvec3(boxes[k].first), hi)) &&
                           glm::all(glm::greaterThanEqual(dvec3(boxes[k].second), lo));
      if (k == i || !overlap) return;
      if (++own.count <= kMostAround) listed_.push_back(static_cast<uint32_t>(k));
    });
    if (own.count > kMostAround) listed_.resize(own.first);
  }
}

std::pair<double, double> Instances::part(size_t number, const Ray& ray, double t_max) const {
  const Ray local = all_[number].to_local(ray);
  double t0 = 0, t1 = t_max;
  for (int a = 0; a < 3; ++a) {
    if (std::abs(local.d[a]) < 1e-300) {
      if (local.o[a] < local_lo_[a] || local.o[a] > local_hi_[a]) return {1, 0};
      continue;
    }
    const double inverse = 1 / local.d[a];
    const double x = (local_lo_[a] - local.o[a]) * inverse, y = (local_hi_[a] - local.o[a]) * inverse;
    t0 = std::max(t0, std::min(x, y));
    t1 = std::min(t1, std::max(x, y));
  }
  return {t0, t1};
}

namespace {

/// A ray against four boxes side by side, in single precision; counted from where it comes into the box of all, so that
/// rounding is as small as that box.
struct FourSlabs {
  /// As wide as the least of instruction sets has it: one function for all.
  using Four [[gnu::vector_size(16)]] = float;
  static Four four(const float* from) {
    Four v;
    std::memcpy(&v, from, sizeof v);
    return v;
  }

  FourSlabs(const dvec3& o, const dvec3& d, double pad) : pad_(static_cast<float>(pad)) {
    for (int a = 0; a < 3; ++a) {
      o_[a] = static_cast<float>(o[a]);
      const auto along = static_cast<float>(d[a]);
      inverse_[a] = std::abs(along) < 1e-30f ? std::copysign(1e30f, along) : 1 / along;
    }
  }
  /// @param t  gets where the ray comes into each   @return  bits of those that it meets before `limit`
  uint32_t enters(const float (&lo)[3][4], const float (&hi)[3][4], float limit, float (&t)[4]) const {
    Four t0{}, t1 = Four{} + limit;
    for (int a = 0; a < 3; ++a) {
      const Four x = (four(lo[a]) - pad_ - o_[a]) * inverse_[a], y = (four(hi[a]) + pad_ - o_[a]) * inverse_[a];
      const Four enters = x < y ? x : y, leaves = x < y ? y : x;
      t0 = t0 > enters ? t0 : enters;
      t1 = t1 < leaves ? t1 : leaves;
    }
    std::memcpy(t, &t0, sizeof t0);
    const auto meets = t0 * (1 - kRounding) <= t1 * (1 + kRounding);
    uint32_t bits = 0;
    for (int k = 0; k < 4; ++k) bits |= (meets[k] & 1u) << k;
    return bits;
  }

  static constexpr float kRounding = 1e-6f;

 private:
  float o_[3], inverse_[3], pad_;
};

}  // namespace

size_t Instances::next(const Ray& ray, double t_max, const Met& after, std::span<Met> found) const {
  const double begin = Slabs(ray).enters(lo_, hi_);
  if (!(begin <= t_max)) return 0;
  const dvec3 entry = ray.at(begin);
  const double size = max_component(glm::max(glm::abs(lo_), glm::abs(hi_)));
  const FourSlabs slabs(entry, ray.d, static_cast<double>(FourSlabs::kRounding) * size);
  size_t count = 0;
  const auto bound = [&] { return count < found.size() ? t_max : found[count - 1].t; };
  const auto limit = [&] { return static_cast<float>(std::min(bound() - begin, 1e30)); };
  struct Waiting {
    uint32_t first, count;
    float t;
  };
  std::array<Waiting, kDeepest> stack;
  size_t waiting = 0;
  stack[waiting++] = {0, 0, 0.0f};
  while (waiting > 0) {
    const Waiting from = stack[--waiting];
    if (from.t * (1 - FourSlabs::kRounding) > limit() * (1 + FourSlabs::kRounding)) continue;
    if (from.count == 0) {
      const Node& node = nodes_[from.first];
      float t[kWide];
      const size_t own = waiting;
      for (uint32_t bits = slabs.enters(node.lo, node.hi, limit(), t); bits; bits &= bits - 1) {
        const auto k = static_cast<size_t>(std::countr_zero(bits));
        size_t place = waiting++;  // the nearest last: it is looked at first
        for (; place > own && stack[place - 1].t < t[k]; --place) stack[place] = stack[place - 1];
        stack[place] = {node.first[k], node.count[k], t[k]};
      }
      continue;
    }
    for (uint32_t k = 0; k < from.count; ++k) {
      const uint32_t i = order_[from.first + k];
      const auto [t0, t1] = part(i, ray, t_max);
      const Met met{t0, i};
      if (!(t0 < t1) || !(after < met)) continue;
      size_t place = count;
      while (place > 0 && met < found[place - 1]) --place;
      if (place == found.size()) continue;
      if (count < found.size()) ++count;
      std::copy_backward(found.begin() + static_cast<std::ptrdiff_t>(place),
                         found.begin() + static_cast<std::ptrdiff_t>(count - 1),
                         found.begin() + static_cast<std::ptrdiff_t>(count));
      found[place] = met;
    }
  }
  return count;
}

bool Instances::meets(const Ray& ray, double t_max) const {
  std::array<Met, 1> first;
  return next(ray, t_max, {}, first) > 0;
}

}  // namespace brume
