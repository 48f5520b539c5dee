#include "render/files/polygon.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace brume {
namespace {

/// Twice the signed area of a triangle; exactly 0 where rounding leaves its sign open.
double turn(const dvec2& a, const dvec2& b, const dvec2& c) {
  const double left = (b.x - a.x) * (c.y - a.y), right = (b.y - a.y) * (c.x - a.x);
  const double area = left - right;
  // Shewchuk 1997, the first bound of orient2d.
  constexpr double kBound = 3.4e-16;
  return std::abs(area) > kBound * (std::abs(left) + std::abs(right)) ? area : 0.0;
}

/// The outline as a ring from which corners are cut off. It turns counter-clockwise.
class EarClipper {
 public:
  explicit EarClipper(std::vector<dvec2> points) : p_(std::move(points)), next_(p_.size()), before_(p_.size()) {
    const int n = static_cast<int>(p_.size());
    left_ = n;
    for (int i = 0; i < n; ++i) {
      next_[at(i)] = (i + 1) % n;
      before_[at(i)] = (i + n - 1) % n;
    }
    cut_.assign(p_.size(), false);
    sort();
  }

  std::vector<ivec3> clip() {
    std::vector<ivec3> triangles;
    for (int k = 0; k < static_cast<int>(p_.size()); ++k) drop_turning_back(k);
    int i = first(), tried = 0;
    while (left_ >= 3) {
      if (tried < 2 * left_) {
        if (!is_ear(i, /*may_touch=*/tried >= left_)) {
          i = next_[at(i)];
          ++tried;
          continue;
        }
      } else if (!forced(i)) {
        break;
      }
      const int a = before_[at(i)], c = next_[at(i)];
      if (turn(p_[at(a)], p_[at(i)], p_[at(c)]) > 0) triangles.emplace_back(a, i, c);
      remove(i);
      // Not the neighbour, so that triangles do not all meet in one corner.
      i = next_[at(c)];
      drop_turning_back(a);
      drop_turning_back(c);
      if (cut_[at(i)]) i = first();
      tried = 0;
    }
    // What is left of an outline that crosses itself turns the other way.
    for (int b = next_[at(i)]; left_ >= 3 && next_[at(b)] != i; b = next_[at(b)])
      triangles.emplace_back(i, b, next_[at(b)]);
    return triangles;
  }

 private:
  static size_t at(int i) { return static_cast<size_t>(i); }

  void remove(int i) {
    next_[at(before_[at(i)])] = next_[at(i)];
    before_[at(next_[at(i)])] = before_[at(i)];
    cut_[at(i)] = true;
    --left_;
    if (2 * left_ < static_cast<int>(order_.size())) sort();
  }

  /// Drops a corner where the outline goes back the way it came, or that coincides with its neighbour, and then those
  /// around it where they have become such: nothing lies between.
  void drop_turning_back(int corner) {
    std::vector<int> todo = {corner};
    while (!todo.empty() && left_ > 2) {
      const int i = todo.back();
      todo.pop_back();
      if (cut_[at(i)]) continue;
      const int ia = before_[at(i)], ic = next_[at(i)];
      const dvec2 &a = p_[at(ia)], &b = p_[at(i)], &c = p_[at(ic)];
      if (turn(a, b, c) != 0 || glm::dot(b - a, c - b) > 0) continue;
      remove(i);
      todo.push_back(ia);
      todo.push_back(ic);
    }
  }

  int first() const { return static_cast<int>(std::find(cut_.begin(), cut_.end(), false) - cut_.begin()); }

  /// The corners that are left, by x.
  void sort() {
    order_.clear();
    for (int i = 0; i < static_cast<int>(p_.size()); ++i)
      if (!cut_[at(i)]) order_.push_back(i);
    std::sort(order_.begin(), order_.end(), [&](int i, int j) { return p_[at(i)].x < p_[at(j)].x; });
  }

  /// Whether the triangle at a corner can be cut off: it lies inside, and no other part of the outline in it.
  /// @param may_touch  whether other corners may lie on the cut, as long as the outline does not go in there
  bool is_ear(int i, bool may_touch) const {
    const int ia = before_[at(i)], ic = next_[at(i)];
    const dvec2 &a = p_[at(ia)], &b = p_[at(i)], &c = p_[at(ic)];
    if (!(turn(a, b, c) > 0)) return false;
    const double lo = std::min({a.x, b.x, c.x}), hi = std::max({a.x, b.x, c.x});
    auto q = std::lower_bound(order_.begin(), order_.end(), lo, [&](int j, double x) { return p_[at(j)].x < x; });
    for (; q != order_.end() && p_[at(*q)].x <= hi; ++q) {
      const int j = *q;
      if (cut_[at(j)] || j == ia || j == i || j == ic) continue;
      const dvec2 &p = p_[at(j)], ends[] = {p_[at(before_[at(j)])], p_[at(next_[at(j)])]};
      // Whether the outline goes from p to the inner side of a wedge or of a line.
      const auto enters = [&](const auto& inside) { return inside(ends[0]) || inside(ends[1]); };
      if (p == a || p == b || p == c) {
        // Another corner at the same place, as at the end of an edge there and back.
        const dvec2 &from = p == a ? b : p == b ? c : a, &to = p == a ? c : p == b ? a : b;
        if (enters([&](const dvec2& end) { return turn(p, from, end) > 0 && turn(p, end, to) > 0; })) return false;
        continue;
      }
      const double ab = turn(a, b, p), bc = turn(b, c, p), ca = turn(c, a, p);
      if (ab < 0 || bc < 0 || ca < 0) continue;
      if (ab == 0 && !enters([&](const dvec2& end) { return turn(a, b, end) > 0; })) continue;
      if (bc == 0 && !enters([&](const dvec2& end) { return turn(b, c, end) > 0; })) continue;
      if (ca == 0 && may_touch && !enters([&](const dvec2& end) { return turn(c, a, end) > 0; })) continue;
      return false;
    }
    return true;
  }

  /// A corner to cut off where there is no ear: one without an area, or else the smallest. False where none has any.
  bool forced(int& i) const {
    int smallest = -1;
    double least = std::numeric_limits<double>::infinity();
    for (int k = left_, j = i; k > 0; --k, j = next_[at(j)]) {
      const double area = turn(p_[at(before_[at(j)])], p_[at(j)], p_[at(next_[at(j)])]);
      if (area < 0 || area >= least) continue;
      least = area;
      smallest = j;
    }
    if (smallest < 0) return false;
    i = smallest;
    return true;
  }

  std::vector<dvec2> p_;
  std::vector<int> next_, before_, order_;
  std::vector<bool> cut_;
  int left_ = 0;
};

/// Convex, without corners on straight edges, once around.
bool strictly_convex(std::span<const dvec2> p) {
  const size_t n = p.size();
  int turns_of_x = 0;
  for (size_t i = 0; i < n; ++i) {
    const dvec2 &a = p[i], &b = p[(i + 1) % n], &c = p[(i + 2) % n];
    if (!(turn(a, b, c) > 0)) return false;
    turns_of_x += (b.x - a.x > 0) != (c.x - b.x > 0);
  }
  return turns_of_x <= 2;
}

/// Whether two edges cross in their insides.
bool crosses_itself(std::span<const dvec2> p) {
  const size_t n = p.size();
  std::vector<size_t> order(n), open;
  std::iota(order.begin(), order.end(), size_t{0});
  const auto apart = [](double s, double t) { return (s > 0 && t < 0) || (s < 0 && t > 0); };
  const auto low = [&](size_t i) { return std::min(p[i].x, p[(i + 1) % n].x); };
  const auto high = [&](size_t i) { return std::max(p[i].x, p[(i + 1) % n].x); };
  std::sort(order.begin(), order.end(), [&](size_t i, size_t j) { return low(i) < low(j); });
  for (const size_t i : order) {
    std::erase_if(open, [&](size_t j) { return high(j) < low(i); });
    const dvec2 &a = p[i], &b = p[(i + 1) % n];
    for (const size_t j : open) {
      const dvec2 &c = p[j], &d = p[(j + 1) % n];
      if (apart(turn(a, b, c), turn(a, b, d)) && apart(turn(c, d, a), turn(c, d, b))) return true;
    }
    open.push_back(i);
  }
  return false;
}

/// Whether the corners lie in a plane, to a millionth of their distances.
bool is_flat(std::span<const dvec3> corners, const dvec3& normal) {
  double away = 0, size = 0;
  for (const dvec3& p : corners) {
    away = std::max(away, std::abs(glm::dot(p - corners[0], normal)));
    size = std::max(size, glm::length(p - corners[0]));
  }
  return away <= 1e-6 * size * glm::length(normal);
}

/// Without one coordinate: what is exact stays exact, and a plane keeps its shape but for a stretch.
std::vector<dvec2> along_axis(std::span<const dvec3> corners, int axis, bool backwards) {
  const int u = (axis + (backwards ? 2 : 1)) % 3, v = 3 - axis - u;
  std::vector<dvec2> flat;
  for (const dvec3& p : corners) flat.emplace_back(p[u] - corners[0][u], p[v] - corners[0][v]);
  return flat;
}

/// Seen along a unit normal, as a polygon that is not flat shows most of itself.
std::vector<dvec2> along(std::span<const dvec3> corners, const dvec3& normal) {
  const Frame frame(normal);
  std::vector<dvec2> flat;
  for (const dvec3& p : corners)
    flat.emplace_back(glm::dot(p - corners[0], frame.x), glm::dot(p - corners[0], frame.y));
  return flat;
}

/// The triangles of four corners, where that is plain: convex ones make a fan, those that are not flat the two that
/// face the way the four do, or else meet in the shorter diagonal. Empty where it takes more.
std::vector<ivec3> quad_triangles(std::span<const dvec3> p, const dvec3& normal) {
  const std::vector<ivec3> fan = {{0, 1, 2}, {0, 2, 3}}, other = {{1, 2, 3}, {1, 3, 0}};
  const double least = 1e-9 * glm::dot(normal, normal);
  const auto faces = [&](size_t a, size_t b, size_t c) {
    return glm::dot(normal, glm::cross(p[b] - p[a], p[c] - p[a])) > least;
  };
  const bool by_fan = faces(0, 1, 2) && faces(0, 2, 3), by_other = faces(1, 2, 3) && faces(1, 3, 0);
  if (by_fan && by_other) return fan;
  if (is_flat(p, normal)) return {};
  if (by_fan != by_other) return by_fan ? fan : other;
  return glm::distance(p[0], p[2]) <= glm::distance(p[1], p[3]) ? fan : other;
}

}  // namespace

PolygonTriangles triangulate(std::span<const dvec3> corners) {
  const int n = static_cast<int>(corners.size());
  PolygonTriangles result;
  if (n == 3) {
    result.triangles = {{0, 1, 2}};
    return result;
  }
  // Relative to a corner: far from the origin products of coordinates would lose the polygon.
  dvec3 normal(0), sizes(0);
  for (int i = 0; i < n; ++i) {
    const dvec3 a = corners[static_cast<size_t>(i)] - corners[0],
                b = corners[static_cast<size_t>((i + 1) % n)] - corners[0], part = glm::cross(a, b);
    normal += part;
    sizes += glm::abs(part);
  }
  const auto largest = [](const dvec3& d) { return d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2; };
  int axis = largest(glm::abs(normal));
  // An eight of two equal halves has no normal, and turns both ways.
  const bool turns = std::abs(normal[axis]) > 1e-12 * max_component(sizes);
  if (!turns) axis = largest(sizes);
  if (n == 4 && turns) result.triangles = quad_triangles(corners, normal);
  if (!result.triangles.empty()) return result;
  const std::vector<dvec2> flat = turns && !is_flat(corners, normal) ? along(corners, glm::normalize(normal))
                                                                     : along_axis(corners, axis, normal[axis] < 0);
  const auto fan = [&] {
    for (int i = 2; i < n; ++i) result.triangles.emplace_back(0, i - 1, i);
  };
  if (strictly_convex(flat)) {
    fan();
    return result;
  }
  result.crosses_itself = crosses_itself(flat);
  constexpr int kMostCrossing = 1000;  // corners; beyond, none of them is worth the time
  if (!(result.crosses_itself && (!turns || n > kMostCrossing))) result.triangles = EarClipper(flat).clip();
  if (result.triangles.empty()) {
    fan();
    return result;
  }
  const auto corner = [&](int i) { return flat[static_cast<size_t>(i)]; };
  double area = 0, whole = 0;
  for (const ivec3& t : result.triangles) area += turn(corner(t.x), corner(t.y), corner(t.z));
  for (int i = 2; i < n; ++i) whole += turn(corner(0), corner(i - 1), corner(i));
  result.crosses_itself = result.crosses_itself || !(std::abs(area - whole) <= 1e-6 * area);
  return result;
}

}  // namespace brume
