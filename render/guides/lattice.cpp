#include "render/guides/lattice.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

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

float interpolated(const Lattice& lattice, const NodeValues& values, const dvec3& world) {
  const dvec3 p = glm::clamp(lattice.to_lattice(world), dvec3(0), dvec3(lattice.n - 1));
  const ivec3 i = glm::min(ivec3(p), lattice.n - 2);
  const vec3 f(p - dvec3(i));
  const size_t y = static_cast<size_t>(lattice.row()), x = y * static_cast<size_t>(lattice.n.y);
  const float* const v = values.data() + lattice.index(i.x, i.y, i.z);
  const auto lerp = [](float a, float b, float t) { return a + t * (b - a); };
  const float y0 = lerp(lerp(v[0], v[1], f.z), lerp(v[y], v[y + 1], f.z), f.y);
  const float y1 = lerp(lerp(v[x], v[x + 1], f.z), lerp(v[x + y], v[x + y + 1], f.z), f.y);
  return lerp(y0, y1, f.x);
}

std::vector<dvec3> spiral_of_directions(int count) {
  std::vector<dvec3> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
    const double turn = kPi * (1 + std::sqrt(5.0)) * (i + 0.5);
    directions.emplace_back(r * std::cos(turn), r * std::sin(turn), z);
  }
  return directions;
}

}  // namespace brume
