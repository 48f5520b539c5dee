#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "volume/placement.h"

namespace brume {

/// One of the places where a medium stands; doubles alone, for kernels.
struct Instance {
  Placement::ToLocal to_local;  ///< to the coordinates of the medium's grid
  double density = 1;           ///< factor on its extinction
  dvec3 tint{1};                ///< factor on its albedo
};

/// All places where one medium stands, under a tree of boxes: what a ray costs follows how many it meets.
class Instances {
 public:
  /// @param lo, hi  the medium's box in its own coordinates
  Instances(std::vector<Instance> all, const dvec3& lo, const dvec3& hi);

  size_t size() const { return all_.size(); }
  const Instance& operator[](size_t number) const { return all_[number]; }
  const Instance* data() const { return all_.data(); }
  /// World box around them all.
  const dvec3& lo() const { return lo_; }
  const dvec3& hi() const { return hi_; }
  /// Mean of their voxels' shortest edges [world units].
  double voxel_size() const { return voxel_size_; }
  /// The one whose voxels have the largest optical depth.
  size_t thickest() const { return thickest_; }
  bool tinted() const { return tinted_; }
  size_t bytes() const {
    return all_.size() * (sizeof(Instance) + sizeof(Around)) + nodes_.size() * sizeof(Node) +
           (order_.size() + listed_.size()) * sizeof(uint32_t);
  }

  /// Where a ray comes into an instance's box: its ray parameter, at least 0.
  struct Met {
    double t = -1;
    uint32_t number = 0;
    bool operator<(const Met& other) const { return t < other.t || (t == other.t && number < other.number); }
  };
  /// The first instances that a world ray meets before t_max and after another one, in order.
  /// @return how many; fewer than there is room for where no more are met
  size_t next(const Ray& ray, double t_max, const Met& after, std::span<Met> found) const;
  /// Those whose boxes overlap that of one; nothing where they are too many to be listed.
  std::optional<std::span<const uint32_t>> around(size_t number) const {
    const Around& own = around_[number];
    if (own.count > kMostAround) return std::nullopt;
    return std::span(listed_).subspan(own.first, own.count);
  }
  /// Whether a ray meets any.
  bool meets(const Ray& ray, double t_max) const;

  /// Calls visit(number) for all that a ray meets before t_max, in no order.
  template <class Visit>
  void each_met(const Ray& ray, double t_max, const Visit& visit) const {
    const Slabs slabs(ray);
    walk([&](const Node& n, size_t k) { return slabs.enters(n.lo_of(k), n.hi_of(k)) <= t_max; },
         [&](uint32_t i) {
           if (const auto [t0, t1] = part(i, ray, t_max); t0 < t1) visit(size_t{i});
         });
  }
  /// The same for all around a point.
  template <class Visit>
  void each_around(const dvec3& p, const Visit& visit) const {
    walk([&](const Node& n, size_t k) { return n.overlaps(k, p, p); },
         [&](uint32_t i) {
           const dvec3 q = all_[i].to_local(p);
           if (glm::all(glm::greaterThanEqual(q, local_lo_)) && glm::all(glm::lessThanEqual(q, local_hi_)))
             visit(size_t{i});
         });
  }
  /// The same for all whose world boxes may overlap another box.
  template <class Visit>
  void each_near(const dvec3& lo, const dvec3& hi, const Visit& visit) const {
    walk([&](const Node& n, size_t k) { return n.overlaps(k, lo, hi); }, [&](uint32_t i) { visit(size_t{i}); });
  }
  /// The part of a world ray in an instance's box, from 0 to t_max; empty (first >= second) where there is none.
  std::pair<double, double> part(size_t number, const Ray& ray, double t_max) const;

 private:
  static constexpr size_t kWide = 4, kDeepest = 128, kMostAround = 12;
  /// Four boxes side by side, each of a node or of a few instances; axis by axis.
  struct Node {
    float lo[3][kWide], hi[3][kWide];          // rounded outwards
    uint32_t first[kWide], count[kWide] = {};  // count: of instances; 0: `first` is a node
    dvec3 lo_of(size_t k) const { return {lo[0][k], lo[1][k], lo[2][k]}; }
    dvec3 hi_of(size_t k) const { return {hi[0][k], hi[1][k], hi[2][k]}; }
    bool overlaps(size_t k, const dvec3& from, const dvec3& to) const {
      return glm::all(glm::lessThanEqual(lo_of(k), to)) && glm::all(glm::greaterThanEqual(hi_of(k), from));
    }
  };
  struct Around {
    uint32_t first = 0, count = 0;  // in listed_; count: more than kMostAround are not listed
  };
  /// A ray against boxes.
  struct Slabs {
    explicit Slabs(const Ray& ray) : o(ray.o), inverse(1.0 / ray.d) {}
    /// The parameter at which it comes into a box; not a number, which is not below any other, where it never does.
    double enters(const dvec3& lo, const dvec3& hi) const {
      double t0 = 0, t1 = std::numeric_limits<double>::infinity();
      for (int a = 0; a < 3; ++a) {
        // Not a number where the ray lies in a face, which then says nothing.
        const double x = (lo[a] - o[a]) * inverse[a], y = (hi[a] - o[a]) * inverse[a];
        t0 = std::max(t0, std::min(x, y));
        t1 = std::min(t1, std::max(x, y));
      }
      return t0 <= t1 ? t0 : kNever;
    }
    dvec3 o, inverse;
  };
  static constexpr double kNever = std::numeric_limits<double>::quiet_NaN();

  template <class Meets, class Visit>
  void walk(const Meets& meets, const Visit& visit) const {
    std::array<uint32_t, kDeepest> stack;
    size_t waiting = 0;
    stack[waiting++] = 0;
    while (waiting > 0) {
      const Node& node = nodes_[stack[--waiting]];
      for (size_t k = 0; k < kWide; ++k) {
        if (!meets(node, k)) continue;
        if (node.count[k] == 0) stack[waiting++] = node.first[k];
        for (uint32_t i = 0; i < node.count[k]; ++i) visit(order_[node.first[k] + i]);
      }
    }
  }
  using Boxes = std::vector<std::pair<vec3, vec3>>;
  uint32_t build(size_t begin, size_t end, const Boxes& boxes);
  size_t halve(size_t begin, size_t end, const Boxes& boxes);
  void list_neighbours(const Boxes& boxes);

  std::vector<Instance> all_;
  std::vector<Node> nodes_;
  std::vector<uint32_t> order_;  // of the instances under the nodes
  std::vector<Around> around_;   // by instance
  std::vector<uint32_t> listed_;
  dvec3 local_lo_, local_hi_, lo_{0}, hi_{0};
  double voxel_size_ = 0;
  size_t thickest_ = 0;
  bool tinted_ = false;
};

}  // namespace brume
