#include "volume/gradient.h"

#include <cmath>
#include <limits>

namespace brume {
namespace {

// The same as interpolated_differences with h = 1 where the 4 x 4 x 4 voxels around p lie in one brick, which is most
// often: no cell is looked up but once.
std::optional<dvec3> differences_in_brick(const BrickGrid& bricks, const dvec3& p) {
  const int size = bricks.cell_size();
  const ivec3 base(glm::floor(p)), in_cell = base & (size - 1), c = (base - in_cell) / size;
  for (int a = 0; a < 3; ++a)
    if (in_cell[a] < 1 || in_cell[a] > size - 2 || base[a] < 0 || c[a] >= bricks.cells()[a]) return std::nullopt;
  const BrickGrid::Cell& cell = bricks.cell(c);
  if (cell.brick == 0) return dvec3(0);
  const int Y = bricks.stored(), X = Y * Y;
  const float* const v = bricks.brick(cell) + in_cell.x * X + in_cell.y * Y + in_cell.z;
  const vec3 f(p - dvec3(base)), g = vec3(1) - f;
  vec3 sum(0);
  for (int corner = 0; corner < 8; ++corner) {
    const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
    const float* const at = v + x * X + y * Y + z;
    const float weight = (x ? f.x : g.x) * (y ? f.y : g.y) * (z ? f.z : g.z);
    sum += weight * vec3(at[X] - at[-X], at[Y] - at[-Y], at[1] - at[-1]);
  }
  return dvec3(0.5f * sum);
}

// Gradient in voxels, by central differences of half width h at the corners of the voxel cell around p.
dvec3 interpolated_differences(const BrickGrid& bricks, const dvec3& p, int h) {
  const ivec3 base(glm::floor(p));
  const dvec3 f = p - dvec3(base);
  dvec3 gradient(0);
  for (int corner = 0; corner < 8; ++corner) {
    const ivec3 o(corner & 1, corner >> 1 & 1, corner >> 2);
    const ivec3 v = base + o;
    const double weight = (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z);
    for (int a = 0; a < 3; ++a) {
      ivec3 step(0);
      step[a] = h;
      gradient[a] += weight * (static_cast<double>(bricks.voxel(v + step)) - bricks.voxel(v - step)) / (2.0 * h);
    }
  }
  return gradient;
}

}  // namespace

std::optional<dvec3> density_gradient(const Medium& medium, const dvec3& local) {
  if (medium.homogeneous()) return std::nullopt;  // a step at the faces, and constant inside
  const BrickGrid& bricks = medium.bricks();
  const dvec3 p = medium.displacement() ? medium.displaced(local) : local;
  for (const int h : {1, 2, 4}) {
    const std::optional<dvec3> fast = h == 1 ? differences_in_brick(bricks, p) : std::nullopt;
    const dvec3 g = fast ? *fast : interpolated_differences(bricks, p, h);
    if (glm::length(g) >= kLeastGradient * bricks.maximum()) return medium.gradient_to_world(g);
  }
  return std::nullopt;
}

std::optional<double> find_surface(const Medium& medium, const Ray& ray, float iso) {
  if (medium.empty()) return std::nullopt;
  if (medium.homogeneous()) {
    const auto [t0, t1] = medium.homogeneous()->intersect(ray);
    if (!(t1 > t0) || !(t1 > 0)) return std::nullopt;
    return std::max(t0, 0.0);
  }
  if (medium.density(ray.o) >= iso) return 0.0;
  const double step = 1.0 / glm::length(ray.d);
  const dvec3 shift = medium.walked_shift();
  MajorantWalk walk(medium.walked(), {ray.o + shift, ray.d}, 0.0, std::numeric_limits<double>::infinity());
  MajorantWalk::Segment s;
  while (walk.next(s)) {
    if (s.majorant < iso) continue;
    const auto density = [&](double t) {
      return medium.displacement() ? static_cast<float>(medium.density(ray.at(t)))
                                   : medium.bricks().lookup_in(*s.cell, s.coordinates, ray.at(t));
    };
    const int steps = std::max(1, static_cast<int>(std::ceil((s.t1 - s.t0) / step)));
    for (int i = 1; i <= steps; ++i) {
      const double t1 = s.t0 + (s.t1 - s.t0) * i / steps;
      if (density(t1) < iso) continue;
      double lo = s.t0 + (s.t1 - s.t0) * (i - 1) / steps, hi = t1;
      for (int k = 0; k < 8; ++k) {
        const double mid = 0.5 * (lo + hi);
        (density(mid) < iso ? lo : hi) = mid;
      }
      return hi;
    }
  }
  return std::nullopt;
}

}  // namespace brume
