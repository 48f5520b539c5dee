#include "volume/instances.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>

#include "volume/instance_search.h"

namespace brume {
namespace {

/// A box that no ray meets.
std::pair<vec3, vec3> nowhere() {
  return {vec3(1e30f), vec3(-1e30f)};
}

// Instances up to which each has a list of those that overlap it: 20 MB of them.
constexpr size_t kMostWithNeighbours = 32768;

/// A ray parameter counted from another one.
float limit_of(double t, double begin) {
  return static_cast<float>(std::clamp(t - begin, 0.0, 1e30));
}

/// A box in single precision around one in double precision.
std::pair<vec3, vec3> rounded_outwards(const dvec3& lo, const dvec3& hi) {
  std::pair<vec3, vec3> box;
  for (int a = 0; a < 3; ++a) {
    // By four times what the conversion rounds: the numbers given may be rounded, too.
    box.first[a] = static_cast<float>(lo[a] - std::abs(lo[a]) * 0x1p-22);
    box.second[a] = static_cast<float>(hi[a] + std::abs(hi[a]) * 0x1p-22);
  }
  return box;
}

/// A world box around an instance's local one.
std::pair<vec3, vec3> box_around(const dmat3& world_from_local, const dvec3& offset, const dvec3& lo, const dvec3& hi) {
  dvec3 from(std::numeric_limits<double>::infinity()), to = -from;
  for (int k = 0; k < 8; ++k) {
    const dvec3 corner{k & 1 ? hi.x : lo.x, k & 2 ? hi.y : lo.y, k & 4 ? hi.z : lo.z};
    const dvec3 p = world_from_local * (corner - offset);
    from = glm::min(from, p);
    to = glm::max(to, p);
  }
  return rounded_outwards(from, to);
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
  size_ = max_component(glm::max(glm::abs(lo_), glm::abs(hi_)));
  nodes_.emplace_back();
  build(0, 0, all_.size(), boxes);
  if (all_.size() <= kMostWithNeighbours) list_neighbours(boxes);
}

/// Orders a range of instances so that those of each part, of `most` or, the last, less, stand together: halved again
/// and again along the widest axis.
/// @param ends  gets the parts' ends
void Instances::divide(size_t begin, size_t end, size_t most, const Boxes& boxes, std::vector<size_t>& ends) {
  if (end - begin <= most) {
    ends.push_back(end);
    return;
  }
  vec3 least(std::numeric_limits<float>::infinity()), greatest = -least;
  const auto middle = [&](uint32_t i) { return boxes[i].first + boxes[i].second; };
  for (size_t k = begin; k < end; ++k) {
    least = glm::min(least, middle(order_[k]));
    greatest = glm::max(greatest, middle(order_[k]));
  }
  const vec3 extent = greatest - least;
  const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
  const size_t parts = (end - begin + most - 1) / most, half = begin + parts / 2 * most;
  const auto at = [&](size_t k) { return order_.begin() + static_cast<std::ptrdiff_t>(k); };
  std::nth_element(at(begin), at(half), at(end), [&](uint32_t a, uint32_t b) {
    const float x = middle(a)[axis], y = middle(b)[axis];
    return x < y || (x == y && a < b);
  });
  divide(begin, half, most, boxes, ends);
  divide(half, end, most, boxes, ends);
}

/// Makes a node of a range of instances: full ones under it, but for the last.
void Instances::build(uint32_t number, size_t begin, size_t end, const Boxes& boxes) {
  constexpr size_t kWide = InstanceNode::kWide;
  size_t most = 1;  // under one of its boxes
  while (most * kWide < end - begin) most *= kWide;
  std::vector<size_t> ends;
  if (most > 1)
    divide(begin, end, most, boxes, ends);
  else
    for (size_t k = begin; k < end; ++k) ends.push_back(k + 1);

  const auto part_begin = [&](size_t k) { return k == 0 ? begin : ends[k - 1]; };
  const auto first = static_cast<uint32_t>(most > 1 ? nodes_.size() : begin);
  if (most > 1) nodes_.resize(nodes_.size() + ends.size());
  InstanceNode& node = nodes_[number];
  node.first = first;
  node.of_instances = most == 1;
  node.fill([&](size_t k) {
    std::pair<vec3, vec3> box = nowhere();
    if (k < ends.size())
      for (size_t i = part_begin(k); i < ends[k]; ++i) {
        box.first = glm::min(box.first, boxes[order_[i]].first);
        box.second = glm::max(box.second, boxes[order_[i]].second);
      }
    return box;
  });
  if (most > 1)
    for (size_t k = 0; k < ends.size(); ++k) build(first + static_cast<uint32_t>(k), part_begin(k), ends[k], boxes);
}

void Instances::list_neighbours(const Boxes& boxes) {
  neighbours_.resize(all_.size());
  for (size_t i = 0; i < all_.size(); ++i) {
    Neighbours& own = neighbours_[i];
    std::tie(own.lo, own.hi) = boxes[i];
    std::vector<uint32_t> overlap;
    each_near(dvec3(own.lo), dvec3(own.hi), [&](size_t k) {
      if (glm::all(glm::lessThanEqual(boxes[k].first, own.hi)) &&
          glm::all(glm::greaterThanEqual(boxes[k].second, own.lo)))
        overlap.push_back(static_cast<uint32_t>(k));
    });
    own.known = overlap.size() <= InstanceNode::kWide;
    if (!own.known) continue;
    own.node.of_instances = true;
    own.node.fill([&](size_t k) { return k < overlap.size() ? boxes[overlap[k]] : nowhere(); });
    std::copy(overlap.begin(), overlap.end(), own.number.begin());
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

double Instances::begin(const Ray& ray) const {
  if (glm::all(glm::greaterThanEqual(ray.o, lo_)) && glm::all(glm::lessThanEqual(ray.o, hi_))) return 0;
  double t0 = 0, t1 = std::numeric_limits<double>::infinity();
  for (int a = 0; a < 3; ++a) {
    // Not a number where the ray lies in a face: it then counts as inside the lower one, as outside the upper one.
    const double inverse = 1 / ray.d[a], x = (lo_[a] - ray.o[a]) * inverse, y = (hi_[a] - ray.o[a]) * inverse;
    t0 = std::max(t0, std::min(x, y));
    t1 = std::min(t1, std::max(x, y));
  }
  return t0 <= t1 ? t0 : std::numeric_limits<double>::quiet_NaN();
}

// Counted from where the ray comes into the box of all, single precision is as fine as that box.
SearchRay Instances::search_ray(const Ray& ray, double begin) const {
  return {begin > 0 ? ray.at(begin) : ray.o, ray.d, size_};
}

void Instances::each_box(const Ray& ray, double t_max, const std::function<void(size_t)>& visit) const {
  const double from = begin(ray);
  if (!(from <= t_max)) return;
  search_instances(nodes_, search_ray(ray, from), limit_of(t_max, from), [&](size_t place) { visit(order_[place]); });
}

void Instances::each_box(const dvec3& lo, const dvec3& hi, const std::function<void(size_t)>& visit) const {
  const auto [from, to] = rounded_outwards(lo, hi);
  search_instances(nodes_, from, to, [&](size_t place) { visit(order_[place]); });
}

size_t Instances::next(const Ray& ray, double begin, double t_max, const Met& after, std::span<Met> found) const {
  if (!(begin <= t_max)) return 0;
  return nearest_instances(nodes_, order_, search_ray(ray, begin), limit_of(t_max, begin), after, found);
}

size_t Instances::next_from(size_t number, const Ray& ray, double t_max, const Met& after, std::span<Met> found) const {
  const auto inside = [&](const dvec3& p) {
    const Neighbours& own = neighbours_[number];
    return glm::all(glm::greaterThanEqual(p, dvec3(own.lo))) && glm::all(glm::lessThanEqual(p, dvec3(own.hi)));
  };
  if (neighbours_.empty() || !neighbours_[number].known || !std::isfinite(t_max) || !inside(ray.o) ||
      !inside(ray.at(t_max)))
    return next(ray, begin(ray), t_max, after, found);
  const Neighbours& own = neighbours_[number];
  return nearest_instances({&own.node, 1}, own.number, search_ray(ray, 0), limit_of(t_max, 0), after, found);
}

bool Instances::meets(const Ray& ray, double t_max) const {
  const double from = begin(ray);
  std::array<Met, 4> some;
  Met last;
  for (;;) {
    const size_t count = next(ray, from, t_max, last, some);
    for (const Met& met : std::span(some).first(count))
      if (const auto [t0, t1] = part(met.number, ray, t_max); t0 < t1) return true;
    if (count < some.size()) return false;
    last = some.back();
  }
}

}  // namespace brume
