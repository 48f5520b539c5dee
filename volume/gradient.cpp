#include "volume/gradient.h"

#include <algorithm>
#include <array>
#include <cmath>

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

/// A point of [t0, t1] where f - iso changes from negative to not negative, given that it does.
template <class Function>
double bisect(const Function& f, double t0, double t1, double iso) {
  for (int k = 0; k < 40 && t0 < t1; ++k) {
    const double middle = 0.5 * (t0 + t1);
    if (middle == t0 || middle == t1) break;
    (f(middle) < iso ? t0 : t1) = middle;
  }
  return t1;
}

/// The first point of [0, 1] where a cubic reaches iso, given its values at 0, 1/3, 2/3 and 1.
std::optional<double> first_root(const std::array<double, 4>& v, double iso) {
  if (v[0] >= iso) return 0.0;
  const double c1 = -5.5 * v[0] + 9 * v[1] - 4.5 * v[2] + v[3], c2 = 9 * v[0] - 22.5 * v[1] + 18 * v[2] - 4.5 * v[3];
  const double c3 = -4.5 * v[0] + 13.5 * v[1] - 13.5 * v[2] + 4.5 * v[3];
  const auto f = [&](double x) { return v[0] + x * (c1 + x * (c2 + x * c3)); };
  // Between its extrema it is monotonic.
  std::array<double, 3> ends{1, 1, 1};
  const double a = 3 * c3, b = 2 * c2, discriminant = b * b - 4 * a * c1;
  if (discriminant > 0) {
    const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
    ends[0] = q / a;
    ends[1] = c1 / q;
    for (double& end : ends)
      if (!(end > 0 && end < 1)) end = 1;
    std::sort(ends.begin(), ends.end());
  }
  double from = 0;
  for (const double end : ends) {
    if (f(end) >= iso) return bisect(f, from, end, iso);
    from = end;
  }
  return std::nullopt;
}

/// Voxel by voxel (Amanatides and Woo 1987).
std::optional<double> surface_in_cell(const BrickGrid& bricks, const Ray& ray, const MajorantWalk::Segment& s,
                                      float iso) {
  const double across = 1e-20 * max_component(glm::abs(ray.d));  // such a ray never reaches the axis's planes
  const float* const values = bricks.brick(*s.cell);
  const ivec3 lowest = s.coordinates * bricks.cell_size();
  const int last = bricks.cell_size() - 1, Y = bricks.stored(), X = Y * Y;
  ivec3 voxel, step;
  dvec3 exit;  // ray parameters where the voxel's planes are reached
  const auto find_exit = [&](int a) {
    const double plane = lowest[a] + voxel[a] + (step[a] > 0 ? 1 : 0);
    const bool parallel = std::abs(ray.d[a]) <= across;
    exit[a] = parallel ? kUnbounded : (plane - ray.o[a]) / ray.d[a];
  };
  const dvec3 entry = ray.at(s.t0) - dvec3(lowest);
  for (int a = 0; a < 3; ++a) {
    step[a] = ray.d[a] < 0 ? -1 : 1;
    const double behind = step[a] > 0 ? std::floor(entry[a] + 1e-9) : std::ceil(entry[a] - 1e-9) - 1;
    voxel[a] = std::clamp(static_cast<int>(behind), 0, last);
    find_exit(a);
  }
  double t = s.t0;
  while (t < s.t1) {
    const int a = exit.x <= exit.y ? (exit.x <= exit.z ? 0 : 2) : (exit.y <= exit.z ? 1 : 2);
    const double next = std::clamp(exit[a], t, s.t1);
    const float* const v = values + voxel.x * X + voxel.y * Y + voxel.z;
    const float most = std::max({v[0], v[1], v[Y], v[Y + 1], v[X], v[X + 1], v[X + Y], v[X + Y + 1]});
    if (most >= iso) {
      const auto density = [&](double at) {
        return static_cast<double>(bricks.lookup_in(*s.cell, s.coordinates, ray.at(at)));
      };
      const double third = (next - t) / 3;
      if (const auto x = first_root({density(t), density(t + third), density(next - third), density(next)}, iso))
        return t + *x * (next - t);
    }
    voxel[a] += step[a];
    if (voxel[a] < 0 || voxel[a] > last) break;
    find_exit(a);
    t = next;
  }
  return std::nullopt;
}

std::optional<double> march_to_surface(const Medium& medium, const Ray& ray, const MajorantWalk::Segment& s,
                                       float iso) {
  const double step = 0.25 / glm::length(ray.d);
  const auto density = [&](double t) { return medium.smooth_density(s, ray.at(t)); };
  const int steps = std::max(1, static_cast<int>(std::ceil((s.t1 - s.t0) / step)));
  for (int i = 1; i <= steps; ++i) {
    const double t0 = s.t0 + (s.t1 - s.t0) * (i - 1) / steps, t1 = s.t0 + (s.t1 - s.t0) * i / steps;
    if (density(t1) >= iso) return bisect(density, t0, t1, iso);
  }
  return std::nullopt;
}

}  // namespace

std::optional<dvec3> density_gradient(const Medium& medium, const dvec3& local) {
  if (medium.homogeneous()) return std::nullopt;  // a step at the faces, and constant inside or gentle
  const BrickGrid& bricks = medium.bricks();
  const dvec3 p = medium.displacement() ? medium.displaced(local) : local;
  for (const int h : {1, 2, 4}) {
    const std::optional<dvec3> fast = h == 1 ? differences_in_brick(bricks, p) : std::nullopt;
    const dvec3 g = fast ? *fast : interpolated_differences(bricks, p, h);
    if (glm::length(g) >= kLeastGradient * bricks.maximum()) return medium.gradient_to_world(g);
  }
  return std::nullopt;
}

std::optional<double> find_isosurface(const Medium& medium, const Ray& ray, float iso, double begin) {
  if (medium.empty()) return std::nullopt;
  if (medium.homogeneous()) {
    const auto [t0, t1] = medium.homogeneous()->intersect(ray);
    if (!(t1 > t0) || !(t1 > begin)) return std::nullopt;
    const double from = std::max(t0, begin);
    const auto& falloff = medium.homogeneous()->falloff;
    if (!falloff || falloff->density(ray.at(from)) >= iso) return from;
    const double sinks = -glm::dot(falloff->slope, ray.d);
    const double t = from + (falloff->height(ray.at(from)) + std::log(static_cast<double>(iso))) / sinks;
    return sinks > 0 && t < t1 ? std::optional(t) : std::nullopt;
  }
  if (medium.smooth_density(ray.at(begin)) >= iso) return begin;
  MajorantWalk walk = medium.walk(ray, begin, kUnbounded);
  MajorantWalk::Segment s;
  while (walk.next(s)) {
    if (s.majorant < iso) continue;  // of detail's majorant, too: the density without it is below
    const std::optional<double> t =
        medium.displacement() ? march_to_surface(medium, ray, s, iso) : surface_in_cell(medium.bricks(), ray, s, iso);
    if (t) return t;
  }
  return std::nullopt;
}

}  // namespace brume
