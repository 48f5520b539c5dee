#include "volume/velocity_component.h"

#include <array>

#include "volume/cell_values.h"

namespace brume {
namespace {

/// Linear between two values, with the roundings of OpenVDB's samplers.
float between(float a, float b, double weight) {
  return a + static_cast<float>(static_cast<double>(b - a) * weight);
}

}  // namespace

VelocityComponent::VelocityComponent(const StoredVelocity::Component& component, const dmat4& world_from_density)
    : from_density_(component.world_from_index == world_from_density
                        ? dmat4(1)  // one lattice, as a rule: then no rounding moves its points
                        : glm::inverse(glm::inverse(world_from_density) * component.world_from_index)),
      shift_(component.shift),
      one_lattice_(from_density_ == dmat4(1) && shift_ == dvec3(0)),
      values_(component.values),
      stored_(component.stored) {}

std::optional<float> VelocityComponent::of_brick(const ivec3& lo) const {
  if (!one_lattice_) return {};
  const std::optional<float> stored = constant_in(stored_.grid(), lo);
  return stored && *stored == 1 ? constant_in(values_.grid(), lo) : std::optional<float>();
}

std::optional<float> VelocityComponent::operator()(const ivec3& v) {
  if (one_lattice_) {
    if (stored_(v) == 0) return {};
    return values_(v);
  }
  const dvec3 q = dvec3(from_density_ * glm::dvec4(dvec3(v), 1.0)) + shift_;
  const ivec3 base(glm::floor(q));
  const dvec3 f = q - dvec3(base);
  std::array<float, 8> values;
  double sum = 0, weight = 0;
  int known = 0;
  for (int k = 0; k < 8; ++k) {
    const ivec3 o(k >> 2, k >> 1 & 1, k & 1);
    if (stored_(base + o) == 0) continue;
    ++known;
    values[static_cast<size_t>(k)] = values_(base + o);
    const double w = (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z);
    sum += w * static_cast<double>(values[static_cast<size_t>(k)]);
    weight += w;
  }
  if (known == 8)
    return between(between(between(values[0], values[1], f.z), between(values[2], values[3], f.z), f.y),
                   between(between(values[4], values[5], f.z), between(values[6], values[7], f.z), f.y), f.x);
  if (!(weight > 0)) return {};
  return static_cast<float>(sum / weight);
}

}  // namespace brume
