#include "render/guides/lit_surface.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/world/bsdf.h"

namespace brume {
namespace {

constexpr double kFar = 1e30;
constexpr double kDark = 50;  // optical depth behind which nothing is lit

}  // namespace

dvec3 reflected_light(const GroupLight& g, const SkyShares& sky, const Lattice& lattice, const Lights& lights,
                      const Surfaces& surfaces, GuideColour colour, const Ray& ray, const SurfaceHit& hit) {
  const dvec3 p = Surfaces::leave(hit, ray.at(hit.t), -ray.d);
  const dvec3 normal = glm::dot(hit.shading, ray.d) > 0 ? -hit.shading : hit.shading;
  const Bsdf bsdf = surfaces.bsdf(hit);
  const Frame frame(normal);
  const auto to_frame = [&](const dvec3& d) {
    return dvec3(glm::dot(d, frame.x), glm::dot(d, frame.y), glm::dot(d, frame.z));
  };
  switch (g.group.kind) {
    case LightGroup::Kind::kSun:
    case LightGroup::Kind::kLocal: {
      LocalLight light;
      double depth;
      if (g.group.sun) {
        light = {g.group.sun->axis(), kFar, g.group.sun->irradiance()};
        depth = g.sun.at(p);
      } else {
        light = local_light(*g.group.lights[0], p);
        depth = static_cast<double>(interpolated(lattice, g.depth, p));
      }
      if (!(glm::dot(light.towards, normal) > 0) || !(depth < kDark)) return dvec3(0);
      return light.irradiance * attenuation(depth) * surfaces.passage({p, light.towards}, light.distance).light *
             bsdf.value(to_frame(-ray.d), to_frame(light.towards), false);
    }
    case LightGroup::Kind::kSky: {
      if (bsdf.kind == Bsdf::Kind::kConductor)
        return bsdf.albedo * lights.environment()->radiance(glm::reflect(ray.d, normal)) *
               (g.group.channel == kGrey ? dvec3(1) : g.group.colour);
      const ivec3 node = glm::clamp(ivec3(glm::round(lattice.to_lattice(p))), ivec3(1), lattice.n - 2);
      const size_t i = lattice.index(node.x, node.y, node.z);
      const std::vector<dvec3>& directions = ScatteringSolver::directions();
      double sum = 0;
      for (size_t d = 0; d < directions.size(); ++d)
        sum += std::max(0.0, glm::dot(normal, -directions[d])) * g.incoming[d] * static_cast<double>(sky(i, d));
      return bsdf.albedo * (colour == kGrey ? g.group.colour : dvec3(1)) *
             (4 * sum / static_cast<double>(directions.size()));
    }
    case LightGroup::Kind::kGlow: {
      // No nearer than a flame's own extent, where it is no point.
      const double extent = 0.25 * lattice.spacing * max_component(dvec3(lattice.n)) / 4;
      dvec3 light(0);
      for (const GroupLight::Flame& flame : g.flames) {
        const dvec3 to = flame.position - p;
        const double distance2 = glm::dot(to, to) + extent * extent;
        if (glm::dot(to, normal) > 0)
          light +=
              flame.intensity / distance2 * bsdf.value(to_frame(-ray.d), to_frame(to / std::sqrt(distance2)), false);
      }
      return light;
    }
    case LightGroup::Kind::kOthers:
    case LightGroup::Kind::kSurfaces:
      break;
  }
  return dvec3(0);
}

}  // namespace brume
