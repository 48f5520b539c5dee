#pragma once
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "render/world/light.h"

namespace brume {

/// Many lights that stand somewhere, in a binary tree of balls around them: what asks for some of them pays for their
/// logarithm.
///
/// Source: Conty, Kulla 2018, Importance Sampling of Many Lights with Adaptive Tree Splitting; the cut: Walter et al.
/// 2005, Lightcuts. A node promises its power over the mean squared distance of its lights, and almost nothing where
/// all of them shine elsewhere. Where that is too rough, near the lights, the choice is among more and smaller nodes.
class LightTree {
 public:
  /// Up to so many lights are better weighed one by one.
  static constexpr size_t kFew = 48;

  LightTree() = default;
  /// @param lights  each has a place()
  explicit LightTree(std::vector<const Light*> lights);

  bool empty() const { return lights_.empty(); }
  /// A node, and what it promises to bring to a point.
  struct Promise {
    double importance;
    uint32_t node;
  };
  /// Nodes that together hold all lights.
  struct Cut {
    std::vector<Promise> nodes;
    double importance = 0;
  };
  /// Nodes parted until where in them the lights are changes less than `doubt` of what all promise to bring to p. The
  /// next call on this thread changes it.
  const Cut& cut(const dvec3& p, double doubt = kDoubt) const;
  /// One of the lights, about as likely as what it brings to p, and the probability of that.
  std::pair<const Light*, double> pick(const Cut& cut, const dvec3& p, double choice) const;
  /// Of picking one that is in the tree, by its number in the list.
  double probability(const Cut& cut, const dvec3& p, size_t number) const;
  /// Calls visit(number) for those whose balls a ray meets before t_max.
  template <class Visit>
  void along(const Ray& ray, double t_max, const Visit& visit) const {
    std::array<uint32_t, 2 * kDeepest> left{0};
    for (size_t count = lights_.empty() ? 0 : 1; count > 0;) {
      const Node& node = nodes_[left[--count]];
      const dvec3 to = node.centre - ray.o;
      const double middle = glm::dot(to, ray.d), r2 = node.radius * node.radius;
      const dvec3 off = to - middle * ray.d;
      if (glm::dot(off, off) > r2 || middle + node.radius < 0 || middle - node.radius > t_max) continue;
      if (node.leaf()) {
        for (uint32_t i = node.first; i < node.end; ++i) visit(order_[i]);
        continue;
      }
      left[count++] = node.child;
      left[count++] = node.child + 1;
    }
  }
  /// Some lights that stand for all: light `number` times `factor`, a colour over its own luminance.
  struct Stand {
    size_t number;
    dvec3 factor;
  };
  std::vector<Stand> stands(const dvec3& p, double doubt) const;

 private:
  static constexpr size_t kDeepest = 64;
  static constexpr double kDoubt = 0.05;

  /// A ball around lights; of a single one, a leaf of the tree, the light itself answers.
  struct Node {
    dvec3 centre{0}, colour{0};  ///< mean place; the power of all
    double radius = 0, power = 0;
    double variance = 0;  ///< of the places
    dvec3 axis{0};
    double cone = kPi;            ///< half angle around the axis in which all of it shines
    uint32_t first = 0, end = 0;  ///< lights, of order_
    uint32_t child = 0;           ///< the next one is the other; 0 of a leaf
    uint32_t parent = 0;
    size_t strongest = 0;

    bool leaf() const { return child == 0; }
  };

  void build(uint32_t node, size_t depth);
  Node around(uint32_t first, uint32_t end) const;
  double importance(const Node& node, const dvec3& p) const;
  Promise promise(uint32_t node, const dvec3& p) const;
  std::vector<const Light*> lights_;
  std::vector<LightPlace> places_;
  std::vector<size_t> order_;
  std::vector<uint32_t> leaf_of_;
  std::vector<Node> nodes_;
};

}  // namespace brume
