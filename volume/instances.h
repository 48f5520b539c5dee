#pragma once
#include <array>
#include <cstdint>
#include <functional>
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

/// Boxes side by side, for kernels: of further nodes or of instances.
struct alignas(64) InstanceNode {
  static constexpr size_t kWide = 16;
  float face[2][3][kWide];  ///< the lower faces axis by axis, then the upper ones; rounded outwards. Of boxes that
                            ///< there are not, the lower ones lie beyond the upper ones, so that nothing meets them
  uint32_t first = 0;  ///< what the first box is of: a node, or a place in the order of instances; the others follow
  bool of_instances = false;

  /// @param box  (k): the lower and upper corner of the k-th box
  template <class Box>
  void fill(const Box& box) {
    for (size_t k = 0; k < kWide; ++k) {
      const auto [lo, hi] = box(k);
      for (int a = 0; a < 3; ++a) face[0][a][k] = lo[a], face[1][a][k] = hi[a];
    }
  }
};

/// A ray from where it comes into the box around all instances.
struct SearchRay {
  dvec3 o, d;
  double size;  ///< largest coordinate of that box
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
    return all_.size() * (sizeof(Instance) + sizeof(uint32_t)) + nodes_.size() * sizeof(InstanceNode) +
           neighbours_.size() * sizeof(Neighbours);
  }

  /// Where a ray comes into the world box around an instance: at least 0, counted from `begin`.
  struct Met {
    float t = -1;
    uint32_t number = 0;
    bool operator<(const Met& other) const { return t < other.t || (t == other.t && number < other.number); }
  };
  /// The ray parameter at which a world ray comes into the box around all; not a number where it never does.
  double begin(const Ray& ray) const;
  /// The first instances whose world boxes a ray meets before t_max and after another one, in order. Some of them it
  /// misses: what it meets in their own coordinates is left to whoever takes it there.
  /// @param begin  of the ray   @return  how many; fewer than there is room for where no more are met
  size_t next(const Ray& ray, double begin, double t_max, const Met& after, std::span<Met> found) const;
  /// The same of a ray that begins in the world box around one of them: where it ends in there, too, those that overlap
  /// it are all that it can meet.
  size_t next_from(size_t number, const Ray& ray, double t_max, const Met& after, std::span<Met> found) const;
  /// Whether a ray meets any.
  bool meets(const Ray& ray, double t_max) const;

  /// Calls visit(number) for all that a ray meets before t_max, in no order.
  template <class Visit>
  void each_met(const Ray& ray, double t_max, const Visit& visit) const {
    each_box(ray, t_max, [&](size_t i) {
      if (const auto [t0, t1] = part(i, ray, t_max); t0 < t1) visit(i);
    });
  }
  /// Calls visit(number) for all whose boxes hold a point.
  template <class Visit>
  void each_around(const dvec3& p, const Visit& visit) const {
    each_near(p, p, [&](size_t i) {
      const dvec3 q = all_[i].to_local(p);
      if (glm::all(glm::greaterThanEqual(q, local_lo_)) && glm::all(glm::lessThanEqual(q, local_hi_))) visit(i);
    });
  }
  /// The same for all whose world boxes may overlap another box.
  template <class Visit>
  void each_near(const dvec3& lo, const dvec3& hi, const Visit& visit) const {
    each_box(lo, hi, visit);
  }
  /// The part of a world ray in an instance's box, from 0 to t_max; empty (first >= second) where there is none.
  std::pair<double, double> part(size_t number, const Ray& ray, double t_max) const;

 private:
  /// Calls visit(number) for all whose world boxes a ray meets before t_max, and maybe for a few more.
  void each_box(const Ray& ray, double t_max, const std::function<void(size_t)>& visit) const;
  /// The same for those that overlap another box.
  void each_box(const dvec3& lo, const dvec3& hi, const std::function<void(size_t)>& visit) const;
  SearchRay search_ray(const Ray& ray, double begin) const;
  /// What overlaps an instance, itself included.
  struct Neighbours {
    InstanceNode node;
    std::array<uint32_t, InstanceNode::kWide> number;
    vec3 lo, hi;  // the instance's world box
    bool known;   // false where they are more than a node holds
  };
  using Boxes = std::vector<std::pair<vec3, vec3>>;
  void list_neighbours(const Boxes& boxes);
  void build(uint32_t number, size_t begin, size_t end, const Boxes& boxes);
  void divide(size_t begin, size_t end, size_t most, const Boxes& boxes, std::vector<size_t>& ends);

  std::vector<Instance> all_;
  std::vector<InstanceNode> nodes_;
  std::vector<uint32_t> order_;         // of the instances under the nodes
  std::vector<Neighbours> neighbours_;  // by instance; of all or none
  dvec3 local_lo_, local_hi_, lo_{0}, hi_{0};
  double voxel_size_ = 0, size_ = 0;  // size_: largest coordinate of the box around all
  size_t thickest_ = 0;
  bool tinted_ = false;
};

}  // namespace brume
