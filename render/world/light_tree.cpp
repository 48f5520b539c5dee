#include "render/world/light_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/math.h"

namespace brume {
namespace {

// What a light still promises outside of its cone: the choice never rests on rounding.
constexpr double kOutside = 1e-3;
constexpr double kLeastDistance2 = 1e-60;

}  // namespace

LightTree::LightTree(std::vector<const Light*> lights) : lights_(std::move(lights)), leaf_of_(lights_.size()) {
  for (const Light* light : lights_) places_.push_back(*light->place());
  order_.resize(lights_.size());
  std::iota(order_.begin(), order_.end(), size_t{0});
  if (lights_.empty()) return;
  nodes_.push_back(around(0, static_cast<uint32_t>(lights_.size())));
  build(0, 1);
}

LightTree::Node LightTree::around(uint32_t first, uint32_t end) const {
  Node node;
  node.first = first;
  node.end = end;
  dvec3 lo(std::numeric_limits<double>::infinity()), hi = -lo;
  node.strongest = order_[first];
  for (uint32_t i = first; i < end; ++i) {
    const LightPlace& place = places_[order_[i]];
    lo = glm::min(lo, place.centre - place.radius);
    hi = glm::max(hi, place.centre + place.radius);
    node.colour += place.power;
    node.axis += luminance(place.power) * place.axis;
    if (luminance(place.power) > luminance(places_[node.strongest].power)) node.strongest = order_[i];
  }
  node.power = luminance(node.colour);
  node.centre = end - first == 1 ? places_[order_[first]].centre : 0.5 * (lo + hi);
  node.axis = glm::dot(node.axis, node.axis) > 0 ? glm::normalize(node.axis) : dvec3(0, 0, 1);
  node.cone = 0;
  for (uint32_t i = first; i < end; ++i) {
    const LightPlace& place = places_[order_[i]];
    node.radius = std::max(node.radius, glm::distance(place.centre, node.centre) + place.radius);
    const double apart = place.cone < kPi ? std::acos(std::clamp(glm::dot(place.axis, node.axis), -1.0, 1.0)) : 0;
    node.cone = std::min(kPi, std::max(node.cone, apart + place.cone));
    const dvec3 off = place.centre - node.centre;
    node.variance += glm::dot(off, off) / (end - first);
  }
  return node;
}

void LightTree::build(uint32_t node, size_t depth) {
  const uint32_t first = nodes_[node].first, end = nodes_[node].end;
  if (end - first == 1) {
    leaf_of_[order_[first]] = node;
    return;
  }
  dvec3 lo(std::numeric_limits<double>::infinity()), hi = -lo;
  for (uint32_t i = first; i < end; ++i) {
    lo = glm::min(lo, places_[order_[i]].centre);
    hi = glm::max(hi, places_[order_[i]].centre);
  }
  const dvec3 size = hi - lo;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const double middle = 0.5 * (lo[axis] + hi[axis]);
  const auto begin = order_.begin();
  uint32_t split = static_cast<uint32_t>(
      std::partition(begin + first, begin + end, [&](size_t i) { return places_[i].centre[axis] < middle; }) - begin);
  // Halves of equal number where places do not tell the lights apart, or do so one by one.
  if (split == first || split == end || depth > kDeepest / 2) {
    split = (first + end) / 2;
    std::nth_element(begin + first, begin + split, begin + end,
                     [&](size_t a, size_t b) { return places_[a].centre[axis] < places_[b].centre[axis]; });
  }
  const auto child = static_cast<uint32_t>(nodes_.size());
  nodes_[node].child = child;
  for (const auto& [from, to] : {std::pair(first, split), std::pair(split, end)}) {
    nodes_.push_back(around(from, to));
    nodes_.back().parent = node;
  }
  build(child, depth + 1);
  build(child + 1, depth + 1);
}

double LightTree::importance(const Node& node, const dvec3& p) const {
  if (node.leaf()) return lights_[order_[node.first]]->importance(p);
  const dvec3 from = p - node.centre;
  const double d2 = glm::dot(from, from);
  double shape = 1;
  if (node.cone < kPi && d2 > node.radius * node.radius) {
    const double d = std::sqrt(d2), angle = std::acos(std::clamp(glm::dot(from, node.axis) / d, -1.0, 1.0));
    if (angle > node.cone + std::asin(node.radius / d)) shape = kOutside;
  }
  return shape * node.power / std::max(d2 + node.variance, kLeastDistance2);
}

const LightTree::Cut& LightTree::cut(const dvec3& p, double doubt) const {
  thread_local Cut cut;
  cut.nodes.clear();
  cut.importance = 0;
  std::array<uint32_t, kDeepest + 1> left{0};
  const double most = doubt * importance(nodes_[0], p);
  for (size_t count = 1; count > 0;) {
    const uint32_t at = left[--count];
    const Node& node = nodes_[at];
    const double importance = this->importance(node, p);
    // How much of it hangs on where in the node the lights are.
    const dvec3 off = p - node.centre;
    const double share2 = std::min(1.0, node.radius * node.radius / std::max(glm::dot(off, off), kLeastDistance2));
    if (!node.leaf() && importance * importance * share2 > most * most) {
      left[count++] = node.child + 1;
      left[count++] = node.child;
      continue;
    }
    cut.nodes.push_back({importance, at});
    cut.importance += importance;
  }
  return cut;
}

std::pair<const Light*, double> LightTree::pick(const Cut& cut, const dvec3& p, double choice) const {
  const std::vector<Promise>& among = cut.nodes;
  double left = choice * cut.importance;
  size_t i = 0;
  for (; i + 1 < among.size() && left >= among[i].importance; ++i) left -= among[i].importance;
  double probability = among[i].importance / cut.importance;
  choice = std::min(left / among[i].importance, 1 - 1e-12);
  uint32_t at = among[i].node;
  while (!nodes_[at].leaf()) {
    const uint32_t child = nodes_[at].child;
    const double a = importance(nodes_[child], p), b = importance(nodes_[child + 1], p), first = a / (a + b);
    const bool of_first = choice < first;
    choice = of_first ? choice / first : (choice - first) / (1 - first);
    probability *= of_first ? first : 1 - first;
    at = of_first ? child : child + 1;
  }
  return {lights_[order_[nodes_[at].first]], probability};
}

double LightTree::probability(const Cut& cut, const dvec3& p, size_t number) const {
  double probability = 1;
  for (uint32_t at = leaf_of_[number];; at = nodes_[at].parent) {
    for (const Promise& each : cut.nodes)
      if (each.node == at) return probability * each.importance / cut.importance;
    const uint32_t child = nodes_[nodes_[at].parent].child;
    const double a = importance(nodes_[child], p), b = importance(nodes_[child + 1], p), first = a / (a + b);
    probability *= at == child ? first : 1 - first;
  }
}

std::vector<LightTree::Stand> LightTree::stands(const dvec3& p, double doubt) const {
  std::vector<Stand> stands;
  for (const Promise& each : cut(p, doubt).nodes) {
    const Node& node = nodes_[each.node];
    stands.push_back({node.strongest, node.colour / luminance(places_[node.strongest].power)});
  }
  return stands;
}

}  // namespace brume
