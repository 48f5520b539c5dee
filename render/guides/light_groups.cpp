#include "render/guides/light_groups.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "base/math.h"
#include "render/guides/attenuation.h"

namespace brume {
namespace {

// Lights beyond these share one group: each costs a sweep of the lattice for every order, and a filter dozens of
// guides.
constexpr size_t kMostSuns = 2, kMostLocals = 2;

struct Candidate {
  const Light* light;
  const Sun* sun;
  std::string type;
  dvec3 colour;
  double importance;
};

dvec3 of_mean_one(const dvec3& colour) {
  const double mean = (colour.x + colour.y + colour.z) / 3;
  return mean > 0 ? colour / mean : dvec3(1);
}

/// As of a sphere of the same projected area.
LocalLight mesh_light(const MeshLight& light, const dvec3& p) {
  constexpr double kClear = 1.1;  // of the sphere's radius: shadow rays end before the mesh
  const dvec3 to = light.middle() - p;
  const double distance = glm::length(to);
  if (!(distance > 0)) return {};
  const dvec3 towards = to / distance;
  const double area = light.projected_area(towards), radius = kClear * std::sqrt(area / kPi);
  const double sine2 = std::min(1.0, area / (kPi * distance * distance));
  const double solid_angle = 2 * kPi * sine2 / (1 + std::sqrt(1 - sine2));
  return {towards, std::max(0.01 * distance, distance - radius), solid_angle * light.radiance(),
          std::min(radius, 0.99 * distance)};
}

}  // namespace

LocalLight local_light(const Light& light, const dvec3& p) {
  if (const auto* const mesh = dynamic_cast<const MeshLight*>(&light)) return mesh_light(*mesh, p);
  // Round lights are sampled along their axis, flat ones in their middle.
  const LightSample s = light.sample(p, light.centre() ? dvec2(0, 0.5) : dvec2(0.5));
  if (!(s.pdf > 0)) return {};
  const double radius = light.centre() ? std::max(0.0, glm::distance(*light.centre(), p) - s.distance) : 0;
  return {s.wi, s.distance, s.radiance / s.pdf, radius};
}

double LocalLight::mean_cosine() const {
  const double sine = radius / (distance + radius);
  return radius > 0 ? 0.5 * (1 + std::sqrt(std::max(0.0, 1 - sine * sine))) : 1;
}

bool LocalLight::small() const {
  constexpr double kSmall = 0.2;  // of the distance of its middle: all directions are alike
  return !(distance > 0) || radius < kSmall * (distance + radius);
}

double LocalLight::mean_depth(double depth) const {
  const double mean = small() ? 0 : transmittance(depth);
  return mean > 0 ? -portable_log(mean) : depth;
}

double LocalLight::transmittance(double depth) const {
  constexpr int kRings = 4;
  if (small()) return attenuation(depth);
  const double middle = distance + radius;
  const double cap = 1 - std::sqrt(1 - radius / middle * (radius / middle));
  double sum = 0;
  for (int ring = 0; ring < kRings; ++ring) {
    const double cosine = 1 - cap * (ring + 0.5) / kRings;
    const double way =
        middle * cosine - std::sqrt(std::max(0.0, radius * radius - middle * middle * (1 - cosine * cosine)));
    sum += attenuation(depth * way / distance);
  }
  return sum / kRings;
}

std::vector<LightGroup> light_groups(const Lights& lights, const GuideMedia& media, GuideColour colour) {
  const dvec3 middle = 0.5 * (media.lo() + media.hi());
  std::vector<Candidate> candidates;
  const auto add = [&](const Light* light, const Sun* sun, const char* type) {
    const dvec3 irradiance = sun ? sun->irradiance() : local_light(*light, middle).irradiance;
    if (const double importance = light->importance(middle); importance > 0)
      candidates.push_back({light, sun, type, of_mean_one(irradiance), importance});
  };
  for (const Sun* sun : lights.suns()) add(sun, sun, "sun");
  for (const FiniteLight* light : lights.finite()) add(light, nullptr, light->centre() ? "sphere" : "rectangle");
  for (const PointLight* light : lights.points()) add(light, nullptr, "point");
  for (size_t i = 0; i < lights.mesh_count(); ++i) add(&lights.mesh(i), nullptr, "mesh");
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.importance > b.importance; });

  std::vector<LightGroup> groups;
  std::map<std::string, int> named;
  size_t suns = 0, locals = 0;
  LightGroup others{LightGroup::Kind::kOthers, "others", nullptr, {}, dvec3(0)};
  for (const Candidate& c : candidates) {
    if ((c.sun ? suns++ < kMostSuns : locals++ < kMostLocals)) {
      const int number = ++named[c.type];
      groups.push_back({c.sun ? LightGroup::Kind::kSun : LightGroup::Kind::kLocal,
                        c.type + (number > 1 ? "_" + std::to_string(number) : ""),
                        c.sun,
                        {c.light},
                        c.colour});
    } else {
      others.lights.push_back(c.light);
      others.colour += c.importance * c.colour;
    }
  }
  if (!others.lights.empty()) {
    others.colour = of_mean_one(others.colour);
    groups.push_back(std::move(others));
  }
  const Environment& sky = *lights.environment();
  if (!sky.black() && !sky.constant() && colour == kGrey) {
    for (GuideColour channel = 0; channel < 3; ++channel) {
      dvec3 own(0);
      own[channel] = 1;
      groups.push_back({LightGroup::Kind::kSky, "sky", nullptr, {}, own, channel});
    }
  } else if (!sky.black()) {
    dvec3 mean(0);
    for (const dvec3& d : {dvec3(1, 0, 0), dvec3(-1, 0, 0), dvec3(0, 1, 0), dvec3(0, -1, 0), dvec3(0, 0, 1)})
      mean += sky.radiance(d);
    groups.push_back({LightGroup::Kind::kSky, "sky", nullptr, {}, of_mean_one(mean)});
  }
  if (!media.emissions().empty()) groups.push_back({LightGroup::Kind::kEmission, "glow", nullptr, {}, dvec3(1)});
  return groups;
}

}  // namespace brume
