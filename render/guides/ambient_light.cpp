#include "render/guides/ambient_light.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/attenuation.h"
#include "render/world/bsdf.h"

namespace brume {
namespace {

constexpr int kProbesAcross = 20;  // the longest side of the probes' box
constexpr double kMargin = 0.25;   // of the media's longest side, by which the box reaches beyond them
constexpr int kDirections = 64;
constexpr double kDark = 1e-3;  // transmittance at which a march ends
constexpr int kSourcesAcross = 4;
constexpr int kMostPanes = 8;        // of glass that are looked through
constexpr double kMostBacks = 0.25;  // of a probe's rays, that meet surfaces from behind

/// What a ray meets that is not glass.
struct Wall {
  double distance = kFar;
  bool back = false;  ///< met from behind
};
Wall first_wall(const Surfaces& surfaces, const Ray& ray) {
  double from = 0;
  for (int pane = 0; pane < kMostPanes; ++pane) {
    const auto hit = surfaces.intersect({ray.at(from), ray.d}, kFar);
    if (!hit) return {};
    from += hit->t;
    if (surfaces.bsdf(*hit).kind != Bsdf::Kind::kDielectric) return {from, glm::dot(hit->normal, ray.d) > 0};
    from += 2 * hit->margin;
  }
  return {from, false};
}

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

}  // namespace

AmbientLight::AmbientLight(const GuideMedia& media, const Lattice& lattice, double scale)
    : lattice_(lattice), scale_(scale), nodes_(static_cast<size_t>(lattice.n.x) * lattice.n.y * lattice.n.z) {
  const dvec3 margin(kMargin * max_component(media.hi() - media.lo()));
  grid_ = ProbeGrid(media.lo() - margin, media.hi() + margin, kProbesAcross);
}

const AmbientLight::Node* AmbientLight::node_at(const dvec3& place) const {
  const ivec3 node(glm::floor(place + 0.5));
  if (glm::any(glm::lessThan(node, ivec3(0))) || glm::any(glm::greaterThanEqual(node, lattice_.n))) return nullptr;
  return &nodes_[index(node.x, node.y, node.z)];
}

AmbientLight::Incident AmbientLight::along(const dvec3& p, const dvec3& direction, double distance) const {
  const dvec3 from = lattice_.to_lattice(p);
  auto [t, t_end] = inside_box(from, direction, dvec3(lattice_.n - 1));
  t_end = std::min(t_end, distance / lattice_.spacing);
  Incident light;
  double &scaled = light.scaled_transmittance, &transmittance = light.transmittance;
  for (; t < t_end && scaled > kDark; t += 1) {
    const double length = std::min(1.0, t_end - t);
    const Node* const node = node_at(from + direction * (t + 0.5 * length));
    if (!node) break;
    const double depth = static_cast<double>(node->extinction) * length, whole = depth / scale_;
    const double left = attenuation(depth), kept = attenuation(whole);
    const double seen = scaled * (depth > 1e-9 ? (1 - left) / depth : 1) * length,
                 seen_unscattered = transmittance * (whole > 1e-9 ? (1 - kept) / whole : 1) * length;
    for (int c = 0; c < 3; ++c) {
      const auto k = static_cast<size_t>(c);
      const auto of = [&](size_t moment) { return static_cast<double>(node->scattered[3 * moment + k]); };
      const double emitted = static_cast<double>(node->emitted[k]);
      light.emitted[c] += seen_unscattered * emitted;
      light.scattered[c] +=
          seen * std::max(0.0, of(0) - (direction.x * of(1) + direction.y * of(2) + direction.z * of(3))) +
          std::max(0.0, seen - seen_unscattered) * emitted;
    }
    scaled *= left;
    transmittance *= kept;
  }
  return light;
}

void AmbientLight::find_walls(const Surfaces& surfaces, const Task& task) {
  probes_.resize(static_cast<size_t>(grid_.count()));
  walls_.resize(probes_.size() * kDirections);
  const std::vector<dvec3> directions = spiral_of_directions(kDirections);
  parallel_for(grid_.count(), quiet(task), [&](int i) {
    int backs = 0;
    for (size_t k = 0; k < directions.size(); ++k) {
      const Wall wall = first_wall(surfaces, {grid_.at(i), directions[k]});
      walls_[static_cast<size_t>(i) * kDirections + k] = static_cast<float>(wall.distance);
      backs += wall.back ? 1 : 0;
    }
    probes_[static_cast<size_t>(i)].outside = backs < kMostBacks * kDirections;
  });
}

void AmbientLight::gather(const Surfaces& surfaces, const Environment& sky, const Task& task) {
  if (walls_.empty()) find_walls(surfaces, task);
  const std::vector<dvec3> directions = spiral_of_directions(kDirections),
                           radiance =
                               means_near(directions, sky.constant(), [&](const dvec3&d) { return sky.radiance(d); });
  AmbientCube whole;
  for (const dvec3& direction : directions) whole.add(dvec3(1), direction);
  parallel_for(grid_.count(), quiet(task), [&](int i) {
    const dvec3 p = grid_.at(i);
    Probe& probe = probes_[static_cast<size_t>(i)];
    probe.sky = probe.emitted = probe.scattered = probe.sky_scattered = {};
    for (size_t k = 0; k < directions.size(); ++k) {
      const dvec3& direction = directions[k];
      const float wall = walls_[static_cast<size_t>(i) * kDirections + k];
      const Incident light = along(p, direction, static_cast<double>(wall));
      probe.emitted.add(light.emitted, direction);
      probe.scattered.add(light.scattered, direction);
      if (wall < static_cast<float>(kFar)) continue;
      probe.sky.add(light.transmittance * radiance[k], direction);
      probe.sky_scattered.add(std::max(0.0, light.scaled_transmittance - light.transmittance) * radiance[k], direction);
    }
    for (AmbientCube* const cube : {&probe.sky, &probe.emitted, &probe.scattered, &probe.sky_scattered})
      for (size_t face = 0; face < 6; ++face) cube->face[face] /= whole.face[face];
  });
  find_sources();
}

void AmbientLight::find_sources() {
  sources_.assign(kSourcesAcross * kSourcesAcross * kSourcesAcross, {});
  for (int x = 0; x < lattice_.n.x; ++x)
    for (int y = 0; y < lattice_.n.y; ++y)
      for (int z = 0; z < lattice_.n.z; ++z) {
        const Node& node = nodes_[index(x, y, z)];
        double power = 0;
        for (size_t c = 0; c < 3; ++c) power += static_cast<double>(node.emitted[c] + node.scattered[c]);
        if (!(power > 0)) continue;
        const ivec3 cell = ivec3(x, y, z) * kSourcesAcross / lattice_.n;
        Source& source = sources_[static_cast<size_t>((cell.x * kSourcesAcross + cell.y) * kSourcesAcross + cell.z)];
        source.position += power * lattice_.node(x, y, z);
        source.power += power;
      }
  std::erase_if(sources_, [](const Source& source) { return !(source.power > 0); });
  for (Source& source : sources_) source.position /= source.power;
}

double AmbientLight::strength(const dvec3& p, const dvec3& normal) const {
  constexpr double kLeastCosine = 0.05;
  double sum = 0;
  for (const Source& source : sources_) {
    const dvec3 to = source.position - p;
    const double distance2 = std::max(glm::dot(to, to), lattice_.spacing * lattice_.spacing);
    sum += source.power * std::max(kLeastCosine, glm::dot(to, normal) / std::sqrt(distance2)) / distance2;
  }
  return sum;
}

AmbientLight::Lit AmbientLight::onto(const dvec3& p, const dvec3& normal) const {
  const ProbeGrid::Around around =
      grid_.before(p, normal, [&](int probe) { return probes_[static_cast<size_t>(probe)].outside; });
  Lit light;
  dvec3 sky_scattered(0);
  for (size_t k = 0; k < 8; ++k) {
    const Probe& probe = probes_[static_cast<size_t>(around.probe[k])];
    light.sky += around.weight[k] * probe.sky.onto(normal);
    light.emitted += around.weight[k] * probe.emitted.onto(normal);
    light.scattered += around.weight[k] * probe.scattered.onto(normal);
    sky_scattered += around.weight[k] * probe.sky_scattered.onto(normal);
  }
  const dvec3 nearest = glm::clamp(p, grid_.lo(), grid_.hi());
  if (nearest != p && !sources_.empty()) {
    const double fading = strength(p, normal) / strength(nearest, normal);
    light.emitted *= fading;
    light.scattered *= fading;
  }
  light.scattered += sky_scattered;
  return light;
}

double AmbientLight::depth(const dvec3& from, const dvec3& towards, double distance) const {
  const dvec3 start = lattice_.to_lattice(from);
  auto [t, t_end] = inside_box(start, towards, dvec3(lattice_.n - 1));
  t_end = std::min(t_end, distance / lattice_.spacing);
  double depth = 0;
  for (; t < t_end; t += 1) {
    const double length = std::min(1.0, t_end - t);
    if (const Node* const node = node_at(start + towards * (t + 0.5 * length)))
      depth += static_cast<double>(node->extinction) * length;
  }
  return depth;
}

}  // namespace brume
