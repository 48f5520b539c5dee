#include "volume/ray_cone.h"

#include <algorithm>
#include <cmath>

namespace brume {

RayConeLayers::RayConeLayers(const RayCone& cone, const ivec3& n, double size)
    : cone_(cone), n_(n), size_(size), per_size_(1.0 / size) {
  const dvec3& d = cone.middle.d;
  axis_ = 0;
  for (int a = 1; a < 3; ++a)
    if (std::abs(d[a]) > std::abs(d[axis_])) axis_ = a;
  step_ = d[axis_] < 0 ? -1 : 1;
  if (!(cone.apart_per_t < 0.5 * std::abs(d[axis_]))) return;
  per_d_ = 1.0 / d[axis_];
  per_speed_ = 1.0 / (std::abs(d[axis_]) - cone.apart_per_t);
}

/// Half width around the central ray, with a hundredth of a voxel for rounding.
double RayConeLayers::width(double t) const {
  return cone_.apart + cone_.apart_per_t * std::max(t, 0.0) + 0.01;
}

int RayConeLayers::first(double t) const {
  const double at = (cone_.middle.o[axis_] + t * cone_.middle.d[axis_] - step_ * width(t)) / size_;
  const int layer = static_cast<int>(std::floor(std::clamp(at, -1.0, n_[axis_] + 0.0)));
  return step_ > 0 ? std::max(layer, 0) : std::min(layer, n_[axis_] - 1);
}

RayConeLayers::Layer RayConeLayers::layer(int k) const {
  const double near = reached(step_ > 0 ? k : k + 1), far = reached(step_ > 0 ? k + 1 : k);
  const double early = width(far) * per_speed_;  // by how much other rays enter earlier, or leave later
  const double end = far + early, w = width(end);
  Layer layer{near - early, ivec3(k), ivec3(k)};
  for (int a = 0; a < 3; ++a) {
    if (a == axis_) continue;
    const double p = cone_.middle.o[a] + layer.begin * cone_.middle.d[a],
                 q = cone_.middle.o[a] + end * cone_.middle.d[a];
    const auto cube = [&](double x) {  // floor, within a cube of the lattice
      return static_cast<int>(std::clamp(x * per_size_, -1.0, n_[a] + 0.0) + 1.0) - 1;
    };
    layer.lo[a] = std::max(cube(std::min(p, q) - w), 0);
    layer.hi[a] = std::min(cube(std::max(p, q) + w), n_[a] - 1);
  }
  return layer;
}

// At the far end of the lattice, where the cone is widest.
int RayConeLayers::most_crossed() const {
  const double end = std::max(reached(step_ > 0 ? n_[axis_] : 0), 0.0);
  const double early = width(end) * per_speed_, w = width(end + early);
  double most = 0;
  for (int a = 0; a < 3; ++a)
    if (a != axis_) most = std::max(most, 2 * (w + std::abs(cone_.middle.d[a]) * early));
  return static_cast<int>(std::min(most * per_size_, 1e9)) + 2;
}

int RayConeLayers::Layer::cubes() const {
  const ivec3 n = glm::max(hi - lo + 1, ivec3(0));
  return n.x * n.y * n.z;
}

}  // namespace brume
