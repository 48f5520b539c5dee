#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/lazy_zeros.h"
#include "base/progress.h"
#include "base/vec.h"

namespace brume {

/// Where the planes of a lattice lie along one axis: whole spacings apart, cells of one width in pairs.
struct LatticePlanes {
  std::vector<int> place;  ///< of each plane, in spacings from the first
  /// From one whole place to the next: the index of a place there is first + per_spacing * place.
  std::vector<float> first, per_spacing;

  LatticePlanes() = default;
  explicit LatticePlanes(std::vector<int> places);
  double index(double at) const;
};

/// A part of the world in which the nodes of a lattice are wanted no farther apart along each axis.
struct LatticeRegion {
  dvec3 lo{0}, hi{0}, spacing{1};
};

/// Nodes on a lattice along the world's axes, laid out for sweeps: x slowest, z fastest, rows padded to whole vectors.
/// The outermost nodes on every side are a border where nothing scatters. Its planes are evenly spaced, or farther
/// apart where less happens (rectilinear); then places are told in spacings, and in nodes.
struct Lattice {
  static constexpr int kVector = 16;  ///< floats; rows are a multiple of it

  dvec3 origin{0};     ///< of node (0, 0, 0), the renderer's world space
  double spacing = 1;  ///< of its nearest nodes
  ivec3 n{0};          ///< nodes along each axis, the border included
  dvec3 flat{1};       ///< mean width of cells along each axis, where regions wanted unlike ones; else 1
  std::shared_ptr<const std::array<LatticePlanes, 3>> planes;  ///< null: evenly spaced

  static int padded(int count) { return (count + kVector - 1) / kVector * kVector; }
  int row() const { return padded(n.z); }
  /// Of an array with a value for each node; the tail lets vectors be loaded beyond the last one.
  size_t size() const { return static_cast<size_t>(n.x) * n.y * row() + 2 * kVector; }
  size_t index(int x, int y, int z) const { return (static_cast<size_t>(x) * n.y + y) * row() + z; }
  /// Of a plane, in spacings.
  double place(int axis, int i) const {
    return planes ? (*planes)[static_cast<size_t>(axis)].place[static_cast<size_t>(i)] : i;
  }
  dvec3 node(int x, int y, int z) const { return origin + spacing * dvec3(place(0, x), place(1, y), place(2, z)); }
  /// What of an axis is nearest to a plane, in spacings before it and behind it.
  dvec2 halves(int axis, int i) const;
  /// Size of the cell around a node, in spacings.
  dvec3 cell(int x, int y, int z) const;
  /// To the farthest of the nodes around one [world units].
  double reach(int x, int y, int z) const;
  dvec3 last_place() const { return {place(0, n.x - 1), place(1, n.y - 1), place(2, n.z - 1)}; }

  dvec3 to_spacings(const dvec3& world) const { return (world - origin) / spacing; }
  /// From spacings to nodes.
  dvec3 to_nodes(const dvec3& spacings) const;
  dvec3 to_lattice(const dvec3& world) const { return to_nodes(to_spacings(world)); }

  /// The lattice with the fewest nodes over a box: a spacing as asked for, or wider where that would make too many.
  static Lattice over(const dvec3& lo, const dvec3& hi, double spacing, size_t most_nodes);
  /// One with planes that are as near to each other as regions want them, and ever farther apart around them.
  /// @param spacing  the least; all are wider where that would make too many nodes
  /// @param widest  spacing that is still wanted. @return nothing where that makes too many nodes
  static std::optional<Lattice> graded(const dvec3& lo, const dvec3& hi, std::span<const LatticeRegion> regions,
                                       double spacing, double widest, size_t most_nodes);
  /// Every second plane of a graded lattice.
  Lattice every_second() const;
};

using NodeValues = std::vector<float, LazyZeros<float>>;

/// The nodes around a point, for looking up several fields there: linear between the nodes, outside as on the border.
class NodeWeights {
 public:
  NodeWeights(const Lattice& lattice, const dvec3& world);
  float operator()(const NodeValues& values) const {
    return mean([&](size_t node) { return values[node]; });
  }
  /// @param value  of a node, by its index
  template <class Value>
  float mean(const Value& value) const {
    float sum = weight_[0] * value(node_[0]);
    for (size_t k = 1; k < 8; ++k) sum += weight_[k] * value(node_[k]);
    return sum;
  }

 private:
  std::array<size_t, 8> node_;
  std::array<float, 8> weight_;
};

/// Linear between the nodes; outside as on the border.
float interpolated(const Lattice& lattice, const NodeValues& values, const dvec3& world);

/// Values at the nodes of a lattice of twice the spacing: the mean of eight points around each, a quarter of its
/// spacing off along every axis, linear between the nodes. Of a graded lattice's every second plane, means over the
/// cells around its nodes.
NodeValues coarsened(const Lattice& fine, const NodeValues& values, const Lattice& coarse, const Task& task);

/// Unit vectors evenly spread over the sphere, on a spiral.
std::vector<dvec3> spiral_of_directions(int count);
/// Means of value(d) over the directions that are nearest to each of some. @param constant  whether it does not vary
template <class Value>
auto means_near(const std::vector<dvec3>& directions, bool constant, const Value& value) {
  std::vector<decltype(value(dvec3()))> sum(directions.size());
  std::vector<double> count(directions.size(), 0.0);
  for (const dvec3& d : constant ? directions : spiral_of_directions(4096)) {
    size_t nearest = 0;
    for (size_t k = 1; k < directions.size(); ++k)
      if (glm::dot(directions[k], d) > glm::dot(directions[nearest], d)) nearest = k;
    sum[nearest] += value(d);
    ++count[nearest];
  }
  for (size_t k = 0; k < sum.size(); ++k) sum[k] /= std::max(1.0, count[k]);
  return sum;
}

}  // namespace brume
