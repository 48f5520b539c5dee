#include "render/guides/lattice.h"

#include <cmath>

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

}  // namespace brume
