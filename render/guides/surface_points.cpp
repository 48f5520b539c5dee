#include "render/guides/surface_points.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>

#include "base/golden_ratio.h"
#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/lit_surface.h"

namespace brume {
namespace {

// Points lie so far apart that this many fit along the longest side of the media, and of a mesh; at a distance of the
// media's size from them, 1 + kGrowth times as far apart.
constexpr double kAcrossMedia = 24, kAcrossMesh = 12, kGrowth = 2;
// More points than this are spread farther apart; the second number holds where points are close because another
// surface is near.
constexpr size_t kMostPoints = 4000, kMostWithNear = 6000;
// Where another surface is near, points are no farther apart than kPerReach times the harmonic mean distance to it
// (kReachRays rays look for it as far as kFarthest times the distance between points), but no closer than a share of
// the usual distance: the first of kClosest that does not need too many points.
constexpr double kPerReach = 0.8, kClosest[] = {0.25, 0.4, 0.6}, kFarthest = 2;
constexpr int kReachRays = 12;
constexpr double kSamplesAcross = 2;  // small triangles along a side of the part of a surface that a point stands for
constexpr size_t kMostSamples = 4;    // that a point keeps beside the one in the middle
constexpr double kAlike = 0.5;        // least cosine between normals of points that stand for one another
constexpr size_t kLeaf = 8;           // points in a leaf of the tree
constexpr double kOffPlane = 8;       // squared distances off a surface's plane count so many times more

struct Triangle {
  dvec3 a, b, c;
  dvec3 middle() const { return (a + b + c) / 3.0; }
  double area() const { return 0.5 * glm::length(glm::cross(b - a, c - a)); }
};

/// Visits parts of a triangle that are neither larger nor much longer than a limit, halved along the longest edge.
template <class Limit, class Visit>
void divide(const Triangle& t, const Limit& largest, const Visit& visit, int depth = 0) {
  constexpr int kMostDepth = 24;
  constexpr double kLongest = 8;  // edge, squared, by the largest area
  const auto length2 = [](const dvec3& edge) { return glm::dot(edge, edge); };
  const double ab = length2(t.b - t.a), bc = length2(t.c - t.b), ca = length2(t.a - t.c), limit = largest(t.middle());
  if (depth == kMostDepth || (t.area() <= limit && std::max({ab, bc, ca}) <= kLongest * limit)) return visit(t);
  const Triangle turned = ab >= bc && ab >= ca ? t : bc >= ca ? Triangle{t.b, t.c, t.a} : Triangle{t.c, t.a, t.b};
  const dvec3 middle = 0.5 * (turned.a + turned.b);
  divide({turned.a, middle, turned.c}, largest, visit, depth + 1);
  divide({middle, turned.b, turned.c}, largest, visit, depth + 1);
}

/// Distance to a box, 0 inside.
double distance_to(const dvec3& p, const dvec3& lo, const dvec3& hi) {
  return glm::length(glm::max(glm::max(lo - p, p - hi), dvec3(0)));
}

/// A cell of space in which samples that face alike belong to one point.
struct CellKey {
  ivec3 cell;
  int level, facing;
  bool operator==(const CellKey&) const = default;
};
struct CellHash {
  size_t operator()(const CellKey& k) const {
    size_t h = static_cast<size_t>(k.level * 6 + k.facing);
    for (int a = 0; a < 3; ++a) h = (h ^ static_cast<size_t>(static_cast<uint32_t>(k.cell[a]))) * 0x9E3779B97F4A7C15ull;
    return h ^ h >> 29;
  }
};

}  // namespace

/// Gathers small triangles of surfaces into parts, each of which becomes a point on each of its sides.
class SurfacePoints::Spread {
 public:
  /// @param wider  factor on all distances between points
  Spread(const GuideMedia& media, double wider, const Near& near)
      : media_(media), near_(near), wider_(wider), size_(max_component(media.hi() - media.lo())) {}

  void add(const TriangleMesh& mesh) {
    dvec3 lo(kFar), hi(-kFar);
    for (const dvec3& p : mesh.positions) {
      lo = glm::min(lo, p);
      hi = glm::max(hi, p);
    }
    spacing_of_mesh_ = max_component(hi - lo) / kAcrossMesh;
    const dmat4 moved = mesh.moves() ? mesh.moved(Surfaces::kMiddle) : dmat4(1.0);
    const auto place = [&](const dvec3& p) { return mesh.moves() ? dvec3(moved * glm::dvec4(p, 1.0)) : p; };
    double area = 0;  // of small triangles that share a sample
    for (size_t i = 0; i < mesh.triangles.size(); ++i) {
      const auto [a, b, c] = mesh.corners(i);
      const Triangle whole{place(a), place(b), place(c)};
      const dvec3 normal = glm::normalize(glm::cross(whole.b - whole.a, whole.c - whole.a));
      const auto largest = [&](const dvec3& p) {
        const double side = spacing(p, normal) / kSamplesAcross;
        return side * side;
      };
      divide(whole, largest, [&](const Triangle& t) {
        area += t.area();
        const dvec3 p = t.middle();
        if (area < 0.5 * largest(p) && i + 1 < mesh.triangles.size()) return;
        add_sample(p, normal, area);
        area = 0;
      });
    }
  }

  std::vector<Point> points() {
    for (size_t i = 0; i < parts_.size(); ++i) choose_samples(parts_[i], points_[i]);
    return std::move(points_);
  }

 private:
  struct Part {
    dvec3 sum{0};
    std::vector<std::pair<dvec3, dvec3>> samples;  // place, normal
  };

  /// How far apart points lie at a place of a surface.
  double spacing(const dvec3& p, const dvec3& normal) const {
    const double from_media = distance_to(p, media_.lo(), media_.hi());
    const double far = wider_ * std::min(spacing_of_mesh_, (size_ + kGrowth * from_media) / kAcrossMedia);
    if (!near_.points) return far;
    double close = far;
    for (const double side : {1.0, -1.0})
      if (const int i = near_.points->nearest(p, side * normal); i >= 0)
        close = std::min(close, kPerReach * near_.points->points_[static_cast<size_t>(i)].reach);
    return std::max(close, near_.closest * far);
  }

  void add_sample(const dvec3& p, const dvec3& normal, double area) {
    const int level = static_cast<int>(std::lround(2 * portable_log(spacing(p, normal)) / std::numbers::ln2));
    const double cell = std::sqrt(std::ldexp(1.0, level));
    int axis = std::abs(normal.y) > std::abs(normal.x) ? 1 : 0;
    if (std::abs(normal.z) > std::abs(normal[axis])) axis = 2;
    for (const double side : {1.0, -1.0}) {
      // Not at a whole number of cells, where surfaces often lie.
      const CellKey key{ivec3(glm::floor(p / cell + 0.377)), level, 2 * axis + (side * normal[axis] > 0 ? 1 : 0)};
      const auto [found, fresh] = known_.try_emplace(key, parts_.size());
      if (fresh) {
        parts_.emplace_back();
        points_.emplace_back();
      }
      parts_[found->second].sum += p;
      parts_[found->second].samples.push_back({p, side * normal});
      points_[found->second].area += area;
    }
  }

  /// The sample in the middle first, then others of the whole part.
  static void choose_samples(const Part& part, Point& point) {
    const size_t count = part.samples.size();
    const dvec3 middle = part.sum / static_cast<double>(count);
    const auto by_distance = [&](const auto& x, const auto& y) {
      return glm::distance(x.first, middle) < glm::distance(y.first, middle);
    };
    const double off = 1e-3 * std::sqrt(point.area);
    const auto keep = [&](const std::pair<dvec3, dvec3>& sample) {
      point.samples.push_back({{sample.first + off * sample.second, -sample.second}, {}});
    };
    keep(*std::min_element(part.samples.begin(), part.samples.end(), by_distance));
    const size_t others = std::min(count, kMostSamples);
    for (size_t k = 0; count > 1 && k < others; ++k) keep(part.samples[k * count / others]);
  }

  const GuideMedia& media_;
  const Near& near_;
  const double wider_, size_;
  double spacing_of_mesh_ = 0;
  std::unordered_map<CellKey, size_t, CellHash> known_;  // parts by the cell that they fill
  std::vector<Part> parts_;
  std::vector<Point> points_;  // of the parts
};

void SurfacePoints::spread(const Surfaces& surfaces, const GuideMedia& media, double wider, const Near& near) {
  Spread spread(media, wider, near);
  for (uint32_t s = 0; s < surfaces.count(); ++s)
    if (surfaces.settings(s).material == "diffuse" && surfaces.settings(s).albedo != dvec3(0))
      spread.add(surfaces.mesh(s));
  points_ = spread.points();
}

SurfacePoints::SurfacePoints(const Surfaces& surfaces, const GuideMedia& media, const Task& task) {
  constexpr int kTries = 6;
  double wider = 1;
  for (int i = 0; i < kTries; ++i) {
    spread(surfaces, media, wider, {});
    settle(surfaces, task);
    if (points_.size() <= kMostPoints) break;
    wider *= 1.1 * std::sqrt(static_cast<double>(points_.size()) / kMostPoints);
  }
  grow_tree();
  if (!find_reach(surfaces, task)) return;
  for (const double closest : kClosest) {
    SurfacePoints closer(*this);
    closer.spread(surfaces, media, wider, {this, closest});
    closer.settle(surfaces, task);
    if (closer.points_.size() > kMostWithNear) continue;
    points_ = std::move(closer.points_);
    grow_tree();
    return;
  }
}

void SurfacePoints::grow_tree() {
  tree_.clear();
  for (const Point& point : points_) tree_.push_back({point.p, point.normal, static_cast<int>(tree_.size()), 0});
  build(0, tree_.size());
}

bool SurfacePoints::find_reach(const Surfaces& surfaces, const Task& task) {
  std::vector<uint8_t> near(points_.size());
  parallel_for(static_cast<int>(points_.size()), quiet(task), [&](int i) {
    Point& point = points_[static_cast<size_t>(i)];
    const Frame frame(point.normal);
    const double between = std::sqrt(point.area), farthest = kFarthest * between;
    double sum = 0;
    for (int k = 0; k < kReachRays; ++k) {
      const double sine2 = (k + 0.5) / kReachRays, turn = (k + 0.37 * i) * kGoldenRatio;
      const SinCos phi = portable_sincos_2pi(turn - std::floor(turn));
      const dvec3 d(std::sqrt(sine2) * phi.cos, std::sqrt(sine2) * phi.sin, std::sqrt(1 - sine2));
      if (const auto hit = surfaces.intersect({point.p, frame.to_world(d)}, farthest)) sum += 1 / hit->t;
    }
    if (sum > 0) point.reach = kReachRays / sum;
    near[static_cast<size_t>(i)] = kPerReach * point.reach < between;
  });
  return std::find(near.begin(), near.end(), 1) != near.end();
}

// Drops what lies under another surface.
void SurfacePoints::settle(const Surfaces& surfaces, const Task& task) {
  parallel_for(static_cast<int>(points_.size()), quiet(task), [&](int i) {
    Point& point = points_[static_cast<size_t>(i)];
    std::erase_if(point.samples, [&](auto& sample) {
      auto& [ray, hit] = sample;
      const double off = 1e-3 * std::sqrt(point.area);
      const auto found = surfaces.intersect(ray, 2 * off);
      if (!found || found->t < 0.5 * off) return true;
      hit = *found;
      return false;
    });
    if (point.samples.empty()) return;
    const auto& [ray, hit] = point.samples[0];
    const ShadedPoint at(surfaces, ray, hit);
    point.p = at.p;
    point.normal = at.normal;
    // The first one is only the middle, where there are others.
    const size_t first = point.samples.size() > 1 ? 1 : 0;
    point.samples.erase(point.samples.begin(), point.samples.begin() + static_cast<std::ptrdiff_t>(first));
    for (const auto& sample : point.samples) {
      Bsdf bsdf = surfaces.bsdf(sample.second);
      if (bsdf.kind == Bsdf::Kind::kCoated) bsdf = bsdf.evened();
      point.albedo += bsdf.albedo / static_cast<double>(point.samples.size());
    }
  });
  std::erase_if(points_, [](const Point& point) { return point.samples.empty(); });
}

void SurfacePoints::build(size_t begin, size_t end) {
  if (end - begin <= kLeaf) return;
  dvec3 lo(kFar), hi(-kFar);
  for (size_t i = begin; i < end; ++i) {
    lo = glm::min(lo, tree_[i].p);
    hi = glm::max(hi, tree_[i].p);
  }
  const dvec3 size = hi - lo;
  int axis = size.y > size.x ? 1 : 0;
  if (size.z > size[axis]) axis = 2;
  const size_t middle = (begin + end) / 2;
  const auto at = [&](size_t i) { return tree_.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(at(begin), at(middle), at(end), [&](const Node& a, const Node& b) {
    return a.p[axis] < b.p[axis] || (a.p[axis] == b.p[axis] && a.point < b.point);
  });
  tree_[middle].axis = axis;
  build(begin, middle);
  build(middle + 1, end);
}

/// The nearest points so far, the nearest first.
struct SurfacePoints::Search {
  const dvec3 p, normal;
  const size_t wanted;
  std::array<int, kAround + 1> point{};
  std::array<double, kAround + 1> distance2{};
  size_t count = 0;

  double farthest() const { return count < wanted ? kFar : distance2[count - 1]; }
  void add(int i, double d2) {
    size_t k = count < wanted ? count++ : count - 1;
    for (; k > 0 && distance2[k - 1] > d2; --k) {
      point[k] = point[k - 1];
      distance2[k] = distance2[k - 1];
    }
    point[k] = i;
    distance2[k] = d2;
  }
};

void SurfacePoints::search(size_t begin, size_t end, Search& found) const {
  const auto consider = [&](const Node& node) {
    const dvec3 to = node.p - found.p;
    const double d2 = glm::dot(to, to);
    if (d2 < found.farthest() && glm::dot(node.normal, found.normal) > kAlike) found.add(node.point, d2);
  };
  if (end - begin <= kLeaf) {
    for (size_t i = begin; i < end; ++i) consider(tree_[i]);
    return;
  }
  const size_t middle = (begin + end) / 2;
  const Node& node = tree_[middle];
  consider(node);
  const double behind = found.p[node.axis] - node.p[node.axis];
  const bool first = behind < 0;
  if (first)
    search(begin, middle, found);
  else
    search(middle + 1, end, found);
  if (behind * behind >= found.farthest()) return;
  if (first)
    search(middle + 1, end, found);
  else
    search(begin, middle, found);
}

int SurfacePoints::nearest(const dvec3& p, const dvec3& normal) const {
  Search found{p, normal, 1};
  search(0, tree_.size(), found);
  return found.count ? found.point[0] : -1;
}

SurfacePoints::Around SurfacePoints::around(const dvec3& p, const dvec3& normal) const {
  Search found{p, normal, kAround + 1};
  search(0, tree_.size(), found);
  Around result;
  result.count = std::min(found.count, kAround);
  if (!result.count) return result;
  // Falls to 0 at the first that is not taken.
  const double farthest2 = found.count > kAround ? found.distance2[kAround] : 2 * found.distance2[found.count - 1];
  const Frame frame(normal);
  std::array<dvec2, kAround> place;
  dvec2 mean(0);
  double sum = 0;
  for (size_t k = 0; k < result.count; ++k) {
    const Point& point = points_[static_cast<size_t>(found.point[k])];
    const dvec3 to = point.p - p;
    const double off = glm::dot(to, normal);
    const double near = farthest2 > 0 ? 1 - found.distance2[k] / farthest2 : 1;
    const double weight = (near * near + 1e-9) * glm::dot(point.normal, normal) /
                          (1 + found.distance2[k] / (point.reach * point.reach) +
                           kOffPlane * off * off * static_cast<double>(result.count) / (farthest2 + 1e-300));
    result.point[k] = found.point[k];
    result.weight[k] = weight;
    place[k] = {glm::dot(to, frame.x), glm::dot(to, frame.y)};
    sum += weight;
    mean += weight * place[k];
  }
  mean /= sum;
  double xx = 0, xy = 0, yy = 0;
  for (size_t k = 0; k < result.count; ++k) {
    result.weight[k] /= sum;
    const dvec2 d = place[k] - mean;
    xx += result.weight[k] * d.x * d.x;
    xy += result.weight[k] * d.x * d.y;
    yy += result.weight[k] * d.y * d.y;
  }
  // A plane fitted to the points, where they do not lie in a row; less of it where that leads far from them.
  const double even = 0.05 * (xx + yy) + 1e-300;
  xx += even;
  yy += even;
  const double determinant = xx * yy - xy * xy;
  if (!(determinant > 0)) return result;
  const dvec2 slope = dvec2(yy * mean.x - xy * mean.y, xx * mean.y - xy * mean.x) / determinant;
  const double leads = glm::dot(slope, mean);
  const double share = leads > 1 ? 1 / leads : 1;
  for (size_t k = 0; k < result.count; ++k) result.weight[k] *= 1 - share * glm::dot(slope, place[k] - mean);
  return result;
}

}  // namespace brume
