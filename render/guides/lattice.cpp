#include "render/guides/lattice.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/math.h"
#include "base/parallel_for.h"

namespace brume {

Lattice Lattice::over(const dvec3& lo, const dvec3& hi, double spacing, size_t most_nodes) {
  Lattice lattice;
  for (;;) {
    lattice.spacing = spacing;
    // A node beyond the box on each side, so that fields fall to 0 inside, and the border around them.
    lattice.n = ivec3(glm::ceil((hi - lo) / spacing)) + 4;
    lattice.origin = 0.5 * (lo + hi) - 0.5 * spacing * dvec3(lattice.n - 1);
    const double nodes = static_cast<double>(lattice.n.x) * lattice.n.y * lattice.n.z;
    if (nodes <= static_cast<double>(most_nodes)) return lattice;
    spacing *= std::max(1.02, std::cbrt(nodes / static_cast<double>(most_nodes)));
  }
}

NodeWeights::NodeWeights(const Lattice& lattice, const dvec3& world) {
  const dvec3 p = glm::clamp(lattice.to_lattice(world), dvec3(0), dvec3(lattice.n - 1));
  const ivec3 i = glm::min(ivec3(p), lattice.n - 2);
  const vec3 f(p - dvec3(i)), e = 1.0f - f;
  const size_t y = static_cast<size_t>(lattice.row()), x = y * static_cast<size_t>(lattice.n.y);
  const size_t first = lattice.index(i.x, i.y, i.z);
  node_ = {first, first + 1, first + y, first + y + 1, first + x, first + x + 1, first + x + y, first + x + y + 1};
  weight_ = {e.x * e.y * e.z, e.x * e.y * f.z, e.x * f.y * e.z, e.x * f.y * f.z,
             f.x * e.y * e.z, f.x * e.y * f.z, f.x * f.y * e.z, f.x * f.y * f.z};
}

float interpolated(const Lattice& lattice, const NodeValues& values, const dvec3& world) {
  return NodeWeights(lattice, world)(values);
}

namespace {

/// Along one axis, of the two points: weights of three nodes, of which the first is 2 i + begin for the coarse node i.
struct Taps {
  int begin;
  std::array<float, 3> weight;

  Taps(double fine_origin, double fine_spacing, double coarse_origin) {
    const double first = (coarse_origin - fine_origin) / fine_spacing - 0.5;
    begin = static_cast<int>(std::floor(first));
    const auto f = static_cast<float>(first - begin);
    weight = {0.5f * (1 - f), 0.5f, 0.5f * f};
  }
  int node(int i, int tap, int count) const { return std::clamp(2 * i + begin + tap, 0, count - 1); }
};

}  // namespace

NodeValues coarsened(const Lattice& fine, const NodeValues& values, const Lattice& coarse, const Task& task) {
  NodeValues result(coarse.size());
  const std::array taps = {Taps(fine.origin.x, fine.spacing, coarse.origin.x),
                           Taps(fine.origin.y, fine.spacing, coarse.origin.y),
                           Taps(fine.origin.z, fine.spacing, coarse.origin.z)};
  parallel_for(coarse.n.x, task, [&](int x) {
    // Across x, then across y, then along z.
    const size_t plane = static_cast<size_t>(fine.n.y) * fine.row(), row = static_cast<size_t>(fine.row());
    std::vector<float> across_x(plane), across_y(row);
    const auto mean = [](const Taps& t, const float* a, const float* b, const float* c, size_t count, float* to) {
      for (size_t i = 0; i < count; ++i) to[i] = t.weight[0] * a[i] + t.weight[1] * b[i] + t.weight[2] * c[i];
    };
    const auto at_x = [&](int tap) { return values.data() + fine.index(taps[0].node(x, tap, fine.n.x), 0, 0); };
    mean(taps[0], at_x(0), at_x(1), at_x(2), plane, across_x.data());
    for (int y = 0; y < coarse.n.y; ++y) {
      const auto at_y = [&](int tap) { return across_x.data() + taps[1].node(y, tap, fine.n.y) * row; };
      mean(taps[1], at_y(0), at_y(1), at_y(2), row, across_y.data());
      for (int z = 0; z < coarse.n.z; ++z) {
        float sum = 0;
        for (int tap = 0; tap < 3; ++tap)
          sum +=
              taps[2].weight[static_cast<size_t>(tap)] * across_y[static_cast<size_t>(taps[2].node(z, tap, fine.n.z))];
        result[coarse.index(x, y, z)] = sum;
      }
    }
  });
  return result;
}

std::vector<dvec3> spiral_of_directions(int count) {
  std::vector<dvec3> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
    const double turns = 0.5 * (1 + std::sqrt(5.0)) * (i + 0.5);
    const SinCos turn = portable_sincos_2pi(turns - std::floor(turns));
    directions.emplace_back(r * turn.cos, r * turn.sin, z);
  }
  return directions;
}

}  // namespace brume
