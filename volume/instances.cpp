#include "volume/instances.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace brume {
namespace {

constexpr size_t kMostInLeaf = 2;

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
  nodes_.reserve(2 * (all_.size() / kMostInLeaf + 1));
  nodes_.emplace_back();
  build(0, 0, all_.size(), boxes);
  lo_ = dvec3(nodes_[0].lo);
  hi_ = dvec3(nodes_[0].hi);
}

/// Halves at the median of the widest axis.
void Instances::build(uint32_t node, size_t begin, size_t end, const std::vector<std::pair<vec3, vec3>>& boxes) {
  vec3 lo(std::numeric_limits<float>::infinity()), hi = -lo, least = lo, most = hi;
  for (size_t k = begin; k < end; ++k) {
    const auto& [from, to] = boxes[order_[k]];
    lo = glm::min(lo, from);
    hi = glm::max(hi, to);
    least = glm::min(least, from + to);
    most = glm::max(most, from + to);
  }
  nodes_[node].lo = lo;
  nodes_[node].hi = hi;
  if (end - begin <= kMostInLeaf) {
    nodes_[node].first = static_cast<uint32_t>(begin);
    nodes_[node].count = static_cast<uint32_t>(end - begin);
    return;
  }
  const vec3 extent = most - least;
  const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
  const size_t middle = begin + (end - begin) / 2;
  const auto at = [&](size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
  std::nth_element(at(begin), at(middle), at(end), [&](uint32_t a, uint32_t b) {
    const float x = boxes[a].first[axis] + boxes[a].second[axis], y = boxes[b].first[axis] + boxes[b].second[axis];
    return x < y || (x == y && a < b);
  });
  const auto children = static_cast<uint32_t>(nodes_.size());
  nodes_[node].first = children;
  nodes_.resize(nodes_.size() + 2);
  build(children, begin, middle, boxes);
  build(children + 1, middle, end, boxes);
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

size_t Instances::next(const Ray& ray, double t_max, const Met& after, std::span<Met> found) const {
  const Slabs slabs(ray);
  size_t count = 0;
  const auto bound = [&] { return count < found.size() ? t_max : found[count - 1].t; };
  struct Waiting {
    uint32_t node;
    double t;
  };
  std::array<Waiting, kDeepest> stack;
  size_t waiting = 0;
  const auto wait_for = [&](uint32_t node, double t) {
    if (t <= bound()) stack[waiting++] = {node, t};
  };
  wait_for(0, slabs.enters(nodes_[0]));
  while (waiting > 0) {
    const auto [number, from] = stack[--waiting];
    if (!(from <= bound())) continue;
    const Node& node = nodes_[number];
    if (node.count == 0) {
      const double first = slabs.enters(nodes_[node.first]), second = slabs.enters(nodes_[node.first + 1]);
      const bool swapped = second < first;  // the nearer one is looked at first
      wait_for(node.first + (swapped ? 0 : 1), swapped ? first : second);
      wait_for(node.first + (swapped ? 1 : 0), swapped ? second : first);
      continue;
    }
    for (uint32_t k = 0; k < node.count; ++k) {
      const uint32_t i = order_[node.first + k];
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
