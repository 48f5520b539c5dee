#include "render/guides/ambient_light.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "volume/phase_function.h"

namespace brume {
namespace {

constexpr double kDark = 1e-3;  // transmittance at which a march ends

/// Part of a line that lies in a box from 0 to `size`.
std::pair<double, double> inside_box(const dvec3& from, const dvec3& towards, const dvec3& size) {
  double t0 = 0, t1 = 1e30;
  for (int a = 0; a < 3; ++a) {
    if (std::abs(towards[a]) < 1e-12) {
      if (from[a] < 0 || from[a] > size[a]) return {0, 0};
      continue;
    }
    const double u = -from[a] / towards[a], v = (size[a] - from[a]) / towards[a];
    t0 = std::max(t0, std::min(u, v));
    t1 = std::min(t1, std::max(u, v));
  }
  return {t0, t1};
}

/// How many times its mean a node sends in a direction: as a Henyey-Greenstein lobe of its mean cosine, which is exact
/// where light of one direction is scattered once, and never negative.
double turned_towards(const AmbientLight::Node& node, const dvec3& direction) {
  constexpr double kEven = 0.1, kNarrow = 0.9;  // mean cosines
  double mean = 0;
  dvec3 flux(0);
  for (size_t c = 0; c < 3; ++c) {
    mean += static_cast<double>(node.scattered[c]);
    for (size_t a = 0; a < 3; ++a) flux[static_cast<int>(a)] += static_cast<double>(node.scattered[3 * (a + 1) + c]);
  }
  if (!(mean > 0)) return 0;
  const double along = glm::dot(flux, direction) / mean, length2 = glm::dot(flux, flux) / (mean * mean);
  if (length2 < 9 * kEven * kEven) return std::max(0.0, 1 + along);
  const double length = std::sqrt(length2), g = std::min(length / 3, kNarrow);
  return 4 * kPi * HenyeyGreenstein{g}.value(along / length);
}

}  // namespace

AmbientLight::AmbientLight(const Lattice& lattice, double scale, size_t groups)
    : lattice_(lattice),
      scale_(scale),
      extinctions_(static_cast<size_t>(lattice.n.x) * lattice.n.y * lattice.n.z),
      nodes_(extinctions_.size()),
      groups_(groups),
      of_groups_(nodes_.size() * groups, vec3(0)) {}

AmbientLight AmbientLight::dark() const {
  AmbientLight media(lattice_, scale_);
  media.extinctions_ = extinctions_;
  return media;
}

size_t AmbientLight::bytes() const {
  return extinctions_.size() * sizeof(float) + nodes_.size() * sizeof(Node) + of_groups_.size() * sizeof(vec3);
}

std::optional<size_t> AmbientLight::node_at(const dvec3& place) const {
  const ivec3 node(glm::floor(place + 0.5));
  if (glm::any(glm::lessThan(node, ivec3(0))) || glm::any(glm::greaterThanEqual(node, lattice_.n))) return {};
  return index(node.x, node.y, node.z);
}

AmbientLight::Incident AmbientLight::along(const dvec3& p, const dvec3& direction, double distance,
                                           std::span<dvec3> of_groups) const {
  std::fill(of_groups.begin(), of_groups.end(), dvec3(0));
  const dvec3 from = lattice_.to_spacings(p);
  auto [t, t_end] = inside_box(from, direction, lattice_.last_place());
  t_end = std::min(t_end, distance / lattice_.spacing);
  Incident light;
  double &scaled = light.scaled_transmittance, &transmittance = light.transmittance;
  for (; t < t_end && scaled > kDark; t += 1) {
    const double length = std::min(1.0, t_end - t);
    const std::optional<size_t> at = node_at(lattice_.to_nodes(from + direction * (t + 0.5 * length)));
    if (!at) break;
    const Node* const node = &nodes_[*at];
    if (extinctions_[*at] == 0 && node->emitted == std::array<float, 3>{}) continue;
    const double depth = static_cast<double>(extinctions_[*at]) * length, whole = depth / scale_;
    const double left = attenuation(depth), kept = attenuation(whole);
    const double seen = scaled * (depth > 1e-9 ? (1 - left) / depth : 1) * length,
                 seen_unscattered = transmittance * (whole > 1e-9 ? (1 - kept) / whole : 1) * length;
    const double turned = turned_towards(*node, -direction);
    for (int c = 0; c < 3; ++c) {
      const auto k = static_cast<size_t>(c);
      const double emitted = static_cast<double>(node->emitted[k]),
                   emitted_through_peak = std::max(0.0, seen - seen_unscattered) * emitted;
      light.emitted[c] += seen_unscattered * emitted;
      light.scattered[c] += seen * turned * static_cast<double>(node->scattered[k]) + emitted_through_peak;
      if (!of_groups.empty() && group_of_emissions_) of_groups[*group_of_emissions_][c] += emitted_through_peak;
    }
    for (size_t g = 0; g < of_groups.size(); ++g) of_groups[g] += seen * turned * dvec3(of_groups_[*at * groups_ + g]);
    scaled *= left;
    transmittance *= kept;
  }
  return light;
}

double AmbientLight::depth(const dvec3& from, const dvec3& towards, double distance) const {
  const dvec3 start = lattice_.to_spacings(from);
  auto [t, t_end] = inside_box(start, towards, lattice_.last_place());
  t_end = std::min(t_end, distance / lattice_.spacing);
  const size_t y = lattice_.n.z, x = y * lattice_.n.y;
  double depth = 0;
  for (; t < t_end; t += 1) {
    // Linear between the nodes: shadows on surfaces show them else.
    const double length = std::min(1.0, t_end - t);
    const dvec3 place = lattice_.to_nodes(start + towards * (t + 0.5 * length));
    const ivec3 node = glm::clamp(ivec3(place), ivec3(0), lattice_.n - 2);
    const dvec3 f = place - dvec3(node);
    const float* const first = &extinctions_[index(node.x, node.y, node.z)];
    const auto along_z = [&](const float* at) {
      return static_cast<double>(at[0]) * (1 - f.z) + static_cast<double>(at[1]) * f.z;
    };
    depth += length * ((along_z(first) * (1 - f.y) + along_z(first + y) * f.y) * (1 - f.x) +
                       (along_z(first + x) * (1 - f.y) + along_z(first + x + y) * f.y) * f.x);
  }
  return depth;
}

}  // namespace brume
