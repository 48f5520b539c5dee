#include "volume/medium.h"

#include <cmath>

namespace brume {

std::pair<double, double> HomogeneousShape::intersect(const Ray& ray) const {
  const std::pair<double, double> none{1, 0};
  if (shape == Shape::kBox) {
    double t0 = -kUnbounded, t1 = kUnbounded;
    for (int a = 0; a < 3; ++a) {
      if (std::abs(ray.d[a]) < 1e-300) {
        if (ray.o[a] < lo[a] || ray.o[a] > hi[a]) return none;
        continue;
      }
      const double ta = (lo[a] - ray.o[a]) / ray.d[a], tb = (hi[a] - ray.o[a]) / ray.d[a];
      t0 = std::max(t0, std::min(ta, tb));
      t1 = std::min(t1, std::max(ta, tb));
    }
    return {t0, t1};
  }
  // Scaled to the unit sphere; the point nearest the centre first, so that far origins do not cancel.
  const dvec3 half = 0.5 * (hi - lo), o = (ray.o - 0.5 * (lo + hi)) / half, d = ray.d / half;
  const double dd = glm::dot(d, d), middle = -glm::dot(o, d) / dd;
  const dvec3 nearest = o + middle * d;
  const double inside = 1.0 - glm::dot(nearest, nearest);
  if (!(inside > 0)) return none;
  const double half_chord = std::sqrt(inside / dd);
  return {middle - half_chord, middle + half_chord};
}

bool HomogeneousShape::contains(const dvec3& p) const {
  if (shape == Shape::kBox) return glm::all(glm::greaterThanEqual(p, lo)) && glm::all(glm::lessThanEqual(p, hi));
  const dvec3 q = (p - 0.5 * (lo + hi)) / (0.5 * (hi - lo));
  return glm::dot(q, q) <= 1.0;
}

double HomogeneousShape::maximum() const {
  if (!falloff) return 1;
  dvec3 lowest;
  for (int a = 0; a < 3; ++a) lowest[a] = falloff->slope[a] > 0 ? lo[a] : hi[a];
  return falloff->density(lowest);
}

Medium::Medium(const BrickGrid& bricks, const dmat4& world_from_index, const Coefficients& coefficients,
               const PhaseFunction& phase)
    : bricks_(&bricks), placement_(world_from_index * translation(dvec3(bricks.origin()))), phase_(phase) {
  set_coefficients(coefficients);
}

Medium::Medium(const HomogeneousShape& shape, const dmat4& world_from_local, const Coefficients& coefficients,
               const PhaseFunction& phase)
    : homogeneous_(shape), placement_(world_from_local), phase_(phase) {
  set_coefficients(coefficients);
}

void Medium::set_coefficients(const Coefficients& coefficients) {
  coefficients_ = coefficients;
  sigma_max_ = max_component(coefficients.sigma_t);
  ratio_ = sigma_max_ > 0 ? coefficients.sigma_t / sigma_max_ : dvec3(1);
}

void Medium::set_motion(const dmat4& world_from_index_end) {
  const dmat4 end = homogeneous_ ? world_from_index_end : world_from_index_end * translation(dvec3(bricks_->origin()));
  check_transform(end, "the volume's transform at the shutter's end");
  end_ = end;
}

Placement Medium::placement_at(double time) const {
  return end_ ? Placement(placement_.world_from_local() * (1.0 - time) + *end_ * time) : placement_;
}

Medium Medium::at_time(double time) const {
  Medium moved = *this;
  if (displacement_) moved.time_ = displacement_->open + (displacement_->close - displacement_->open) * time;
  moved.placement_ = placement_at(time);
  return moved;
}

Medium Medium::resampled(int per_voxel, BrickGrid& bricks, const SampleDensity& sample, const Task& task) const {
  if (!displacement_) return *this;
  const double spacing = 1.0 / per_voxel;  // of the lattice, whose index coordinates are local ones over it
  const auto [lo, hi] = support();
  const VoxelBox box{ivec3(glm::ceil(lo / spacing)), ivec3(glm::floor(hi / spacing))};
  const BrickGrid& envelope = walked();
  constexpr int kCell = BrickGrid::kCell;
  const auto may_hold = [&](const ivec3& block) {
    const double cell = envelope.cell_size();
    const dvec3 corner = spacing * kCell * dvec3(block) + walked_shift();
    const ivec3 from = glm::max(ivec3(glm::floor((corner - spacing) / cell)), ivec3(0));
    const ivec3 to = glm::min(ivec3(glm::floor((corner + spacing * (kCell + 1)) / cell)), envelope.cells() - 1);
    for (int x = from.x; x <= to.x; ++x)
      for (int y = from.y; y <= to.y; ++y)
        for (int z = from.z; z <= to.z; ++z)
          if (envelope.cell({x, y, z}).majorant > 0) return true;
    return false;
  };
  std::vector<ivec3> blocks;
  const ivec3 first(glm::floor(dvec3(box.lo) / static_cast<double>(kCell))), last = box.hi / kCell;
  for (int x = first.x; x <= last.x; ++x)
    for (int y = first.y; y <= last.y; ++y)
      for (int z = first.z; z <= last.z; ++z)
        if (may_hold({x, y, z})) blocks.emplace_back(kCell * ivec3(x, y, z));
  bricks = BrickGrid::build(
      box, blocks, [&](const ivec3& corner, float* values) { sample(spacing * dvec3(corner), spacing, values); }, task);
  Medium still = *this;
  still.displacement_ = nullptr;
  still.detail_ = nullptr;
  still.bricks_ = &bricks;
  const dmat4 finer{dmat3(spacing)};
  still.placement_ = Placement(placement_.world_from_local() * finer * translation(dvec3(bricks.origin())));
  return still;
}

std::pair<dvec3, dvec3> Medium::support() const {
  if (homogeneous_) return {homogeneous_->lo, homogeneous_->hi};
  return {walked().support_lo() - walked_shift(), walked().support_hi() - walked_shift()};
}

Medium Medium::instance(size_t number) const {
  const Instance& one = (*instances_)[number];
  Medium medium = *this;
  medium.instances_ = nullptr;
  medium.placement_ = Placement(one.to_local);
  if (colour_)
    medium.colour_placement_ =
        Placement(medium.placement_.world_from_local() * glm::inverse(placement_.world_from_local()) *
                  colour_placement_.world_from_local());
  medium.set_coefficients({coefficients_.sigma_t * one.density, coefficients_.albedo * one.tint});
  return medium;
}

std::array<dvec3, 8> Medium::corners() const {
  const auto [lo, hi] = instances_ ? std::pair(instances_->lo(), instances_->hi()) : support();
  std::array<dvec3, 8> corners;
  for (size_t k = 0; k < 8; ++k) {
    const dvec3 p{k & 1 ? hi.x : lo.x, k & 2 ? hi.y : lo.y, k & 4 ? hi.z : lo.z};
    corners[k] = instances_ ? p : to_world(p);
  }
  return corners;
}

Medium::Sphere Medium::bounding_sphere() const {
  if (instances_) {
    const dvec3 lo = instances_->lo(), hi = instances_->hi();
    return {0.5 * (lo + hi), 0.5 * glm::length(hi - lo)};
  }
  const auto [lo, hi] = support();
  Sphere sphere{to_world(0.5 * (lo + hi)), 0};
  for (int k = 0; k < 8; ++k) {
    const dvec3 corner{k & 1 ? hi.x : lo.x, k & 2 ? hi.y : lo.y, k & 4 ? hi.z : lo.z};
    sphere.radius = std::max(sphere.radius, glm::distance(sphere.centre, to_world(corner)));
    if (end_)
      sphere.radius = std::max(sphere.radius, glm::distance(sphere.centre, dvec3(*end_ * glm::dvec4(corner, 1))));
  }
  return sphere;
}

}  // namespace brume
