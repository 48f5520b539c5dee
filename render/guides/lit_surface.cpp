#include "render/guides/lit_surface.h"

#include <cmath>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/world/bsdf.h"

namespace brume {
namespace {

constexpr double kFar = 1e30;
constexpr double kDark = 50;  // optical depth behind which nothing is lit

/// What surfaces leave of a light at a point: its middle if it is small, else the mean over it, closer where parts
/// of it are hidden.
dvec3 passage_of(const Light& light, const LocalLight& middle, const Surfaces& surfaces, const dvec3& p) {
  const auto mean_of = [&](int across) {
    dvec3 sum(0), first(0);
    bool alike = true;
    for (int i = 0; i < across * across; ++i) {
      const LightSample s = light.sample(p, (dvec2(i % across, i / across) + 0.5) / static_cast<double>(across));
      const dvec3 light_there = surfaces.passage({p, s.wi}, std::min(s.distance, kFar)).light;
      if (i == 0) first = light_there;
      alike = alike && light_there == first;
      sum += light_there;
    }
    return std::pair(sum / static_cast<double>(across * across), alike);
  };
  if (light.delta() || dynamic_cast<const MeshLight*>(&light))
    return surfaces.passage({p, middle.towards}, middle.distance).light;
  const auto [few, alike] = mean_of(2);
  return alike ? few : mean_of(4).first;
}

/// @param depth  without the forward peak
Beam beam_of(const Light& source, const LocalLight& light, double depth, const Surroundings& around, const dvec3& p) {
  Beam beam{light.towards, light.irradiance, {}};
  if (!(depth < kDark)) return beam;
  const dvec3 open = passage_of(source, light, around.surfaces, p);
  const double straight = attenuation(depth / around.scale);
  beam.passed = {straight * open, (attenuation(depth) - straight) * open};
  return beam;
}

}  // namespace

Beam beam_at(const SolvedLight& g, const Surroundings& around, const dvec3& p) {
  if (g.group.sun)
    return beam_of(*g.group.sun, {g.group.sun->axis(), kFar, g.group.sun->irradiance()},
                   around.scale * static_cast<double>(g.sun_in_middle().at(p)), around, p);
  const double depth = static_cast<double>(interpolated(around.lattice, g.depth, p));
  return beam_of(*g.group.lights[0], local_light(*g.group.lights[0], p), around.scale * depth, around, p);
}

Lit diffuse_light(const SolvedLight& g, const Surroundings& around, const dvec3& p, const dvec3& normal) {
  Lit lit;
  switch (g.group.kind) {
    case LightGroup::Kind::kSun:
    case LightGroup::Kind::kLocal: {
      const dvec3 towards = g.group.sun ? g.group.sun->axis() : local_light(*g.group.lights[0], p).towards;
      const double cosine = glm::dot(towards, normal);
      if (!(cosine > 0)) break;
      const Beam beam = beam_at(g, around, p);
      lit.add(cosine / kPi * beam.irradiance, beam.passed);
      break;
    }
    case LightGroup::Kind::kOthers:
      for (const Light* const light : g.group.lights) {
        const LocalLight local = local_light(*light, p);
        const double cosine = glm::dot(local.towards, normal);
        if (!(cosine > 0)) continue;
        const double depth = around.ambient_light ? around.ambient_light->depth(p, local.towards, local.distance) : 0;
        lit.add(cosine / kPi * local.irradiance, beam_of(*light, local, depth, around, p).passed);
      }
      break;
    case LightGroup::Kind::kSky:
      if (around.ambient_light) lit.direct = around.ambient_light->onto(p, normal).sky * g.group.share();
      break;
    case LightGroup::Kind::kEmission:
      if (around.ambient_light) lit.direct = around.ambient_light->onto(p, normal).emitted;
      break;
    case LightGroup::Kind::kSurfaces:
      if (around.surface_light) lit.indirect = around.surface_light->onto(p, normal);
      break;
  }
  return lit;
}

dvec3 reflected_light(const std::vector<SolvedLight>& groups, const Surroundings& around, const Ray& ray,
                      const SurfaceHit& hit) {
  const dvec3 p = Surfaces::leave(hit, ray.at(hit.t), -ray.d);
  const dvec3 normal = glm::dot(hit.shading, ray.d) > 0 ? -hit.shading : hit.shading;
  const Bsdf bsdf = around.surfaces.bsdf(hit);
  dvec3 sum(0);
  if (bsdf.kind == Bsdf::Kind::kDiffuse) {
    if (around.ambient_light) sum += around.ambient_light->onto(p, normal).scattered;
    for (const SolvedLight& g : groups) {
      const Lit lit = diffuse_light(g, around, p, normal);
      sum += lit.direct + lit.indirect;
    }
    return bsdf.albedo * sum;
  }
  const Frame frame(normal);
  const auto to_frame = [&](const dvec3& d) {
    return dvec3(glm::dot(d, frame.x), glm::dot(d, frame.y), glm::dot(d, frame.z));
  };
  for (const SolvedLight& g : groups) {
    if (g.group.kind == LightGroup::Kind::kSun || g.group.kind == LightGroup::Kind::kLocal) {
      const Beam beam = beam_at(g, around, p);
      if (glm::dot(beam.towards, normal) > 0)
        sum += beam.irradiance * (beam.passed.direct + beam.passed.indirect) *
               bsdf.value(to_frame(-ray.d), to_frame(beam.towards), false);
    } else if (g.group.kind == LightGroup::Kind::kSky && bsdf.kind == Bsdf::Kind::kConductor) {
      sum += bsdf.albedo * around.lights.environment()->radiance(glm::reflect(ray.d, normal)) * g.group.share();
    }
  }
  return sum;
}

}  // namespace brume
