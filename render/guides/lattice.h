#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "base/lazy_zeros.h"
#include "base/progress.h"
#include "base/vec.h"

namespace brume {

/// Nodes on a regular lattice along the world's axes, laid out for sweeps: x slowest, z fastest, rows padded to whole
/// vectors. The outermost nodes on every side are a border where nothing scatters.
struct Lattice {
  static constexpr int kVector = 16;  ///< floats; rows are a multiple of it

  dvec3 origin{0};  ///< of node (0, 0, 0), the renderer's world space
  double spacing = 1;
  ivec3 n{0};  ///< nodes along each axis, the border included

  static int padded(int count) { return (count + kVector - 1) / kVector * kVector; }
  int row() const { return padded(n.z); }
  /// Of an array with a value for each node; the tail lets vectors be loaded beyond the last one.
  size_t size() const { return static_cast<size_t>(n.x) * n.y * row() + 2 * kVector; }
  size_t index(int x, int y, int z) const { return (static_cast<size_t>(x) * n.y + y) * row() + z; }
  dvec3 node(int x, int y, int z) const { return origin + spacing * dvec3(x, y, z); }
  dvec3 to_lattice(const dvec3& world) const { return (world - origin) / spacing; }

  /// The lattice with the fewest nodes over a box: a spacing as asked for, or wider where that would make too many.
  static Lattice over(const dvec3& lo, const dvec3& hi, double spacing, size_t most_nodes);
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
/// spacing off along every axis, linear between the nodes.
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
