#include "render/guides/lit_surface.h"

#include <cmath>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/transport/estimator.h"

namespace brume {
namespace {

constexpr double kDark = 50;         // optical depth behind which nothing is lit
constexpr int kHighlightAcross = 4;  // points of a light, and as many directions of a lobe
constexpr double kGoldenRatio = 0.6180339887498949;

// The reflected light of a lamp or sun by points of it and by directions of the lobe, each weighted by the balance
// heuristic, as the tracer does it.
dvec3 highlight(const ShadedPoint& at, const Light& light) {
  constexpr int kPoints = kHighlightAcross * kHighlightAcross;
  const dvec3 wo = at.to_frame(at.wo);
  const auto* const finite = dynamic_cast<const FiniteLight*>(&light);
  const auto* const far = dynamic_cast<const InfiniteLight*>(&light);
  dvec3 sum(0);
  for (int i = 0; i < kPoints; ++i) {
    const dvec2 u = (dvec2(i % kHighlightAcross, i / kHighlightAcross) + 0.5) / static_cast<double>(kHighlightAcross);
    const LightSample sample = light.sample(at.p, u);
    if (!(sample.pdf > 0)) continue;
    const dvec3 wi = at.to_frame(sample.wi);
    if (!(wi.z > 0)) continue;
    const double weight = sample.delta || (!finite && !far) ? 1 : balance(sample.pdf, at.bsdf.pdf(wo, wi, at.inside));
    sum += sample.radiance * at.bsdf.value(wo, wi, at.inside) * (weight / sample.pdf / kPoints);
  }
  if (light.delta() || (!finite && !far)) return sum;
  for (int i = 0; i < kPoints; ++i) {
    Bsdf::Sample sample;
    const dvec3 u((i + 0.5) / kPoints, i * kGoldenRatio - std::floor(i * kGoldenRatio), 0);
    if (!at.bsdf.sample(wo, at.inside, u, sample)) continue;
    const Ray ray{at.p, at.frame.to_world(sample.wi)};
    double density = 0;
    dvec3 radiance(0);
    if (finite) {
      if (const double t = finite->intersect(ray); t > 0) {
        density = finite->pdf(ray, t);
        radiance = finite->radiance(ray, t);
      }
    } else {
      density = far->pdf(ray.d);
      radiance = far->radiance(ray.d);
    }
    if (radiance == dvec3(0)) continue;
    dvec3 weight = sample.weight;
    if (at.bsdf.kind == Bsdf::Kind::kDielectric)
      weight *=
          fresnel_dielectric(glm::dot(wo, glm::normalize(wo + sample.wi)), at.inside ? 1 / at.bsdf.ior : at.bsdf.ior);
    sum += radiance * weight * (balance(sample.pdf, density) / kPoints);
  }
  return sum;
}

}  // namespace

ShadedPoint::ShadedPoint(const Surfaces& surfaces, const Ray& ray, const SurfaceHit& hit)
    : on(ray.at(hit.t)),
      p(Surfaces::leave(hit, on, -ray.d)),
      wo(-ray.d),
      inside(!(glm::dot(hit.normal, ray.d) < 0)),
      bsdf(surfaces.bsdf(hit)),
      frame(dvec3(0, 0, 1)) {
  // As the tracer: the shading normal's angles, but the geometry's side.
  const dvec3 outside = inside ? -hit.normal : hit.normal, smooth = inside ? -hit.shading : hit.shading;
  normal = glm::dot(wo, smooth) > 1e-4 ? smooth : outside;
  frame = Frame(normal);
}

// What surfaces leave of a light at a point: its middle if it is small, else the mean over it, closer where parts
// of it are hidden.
dvec3 LitSurfaces::unshadowed(const Light& light, const LocalLight& middle, const dvec3& p) const {
  const auto mean_of = [&](int across) {
    dvec3 sum(0), first(0);
    bool alike = true;
    for (int i = 0; i < across * across; ++i) {
      const LightSample s = light.sample(p, (dvec2(i % across, i / across) + 0.5) / static_cast<double>(across));
      const dvec3 light_there = surfaces->passage({p, s.wi}, std::min(s.distance, kFar)).light;
      if (i == 0) first = light_there;
      alike = alike && light_there == first;
      sum += light_there;
    }
    return std::pair(sum / static_cast<double>(across * across), alike);
  };
  if (light.delta() || dynamic_cast<const MeshLight*>(&light))
    return surfaces->passage({p, middle.towards}, middle.distance).light;
  const auto [few, alike] = mean_of(2);
  return alike ? few : mean_of(4).first;
}

// @param depth  without the forward peak
Beam LitSurfaces::beam(const Light& source, const LocalLight& light, double depth, const dvec3& p) const {
  Beam beam{light.towards, light.irradiance, {}};
  if (!(depth < kDark)) return beam;
  const dvec3 open = unshadowed(source, light, p);
  const double straight = attenuation(depth / scale);
  beam.transmitted = {straight * open, (attenuation(depth) - straight) * open};
  return beam;
}

Beam LitSurfaces::beam(const SolvedLight& g, const dvec3& p) const {
  if (g.group.sun)
    return beam(*g.group.sun, {g.group.sun->axis(), kFar, g.group.sun->irradiance()},
                scale * static_cast<double>(g.sun_in_middle().at(p)), p);
  const double depth = static_cast<double>(interpolated(lattice, g.depth, p));
  return beam(*g.group.lights[0], local_light(*g.group.lights[0], p), scale * depth, p);
}

// By a surface of albedo 1.
Lit LitSurfaces::onto_diffuse(const SolvedLight& g, const dvec3& p, const dvec3& normal) const {
  Lit lit;
  switch (g.group.kind) {
    case LightGroup::Kind::kSun:
    case LightGroup::Kind::kLocal: {
      const dvec3 towards = g.group.sun ? g.group.sun->axis() : local_light(*g.group.lights[0], p).towards;
      const double cosine = glm::dot(towards, normal);
      if (!(cosine > 0)) break;
      const Beam arriving = beam(g, p);
      lit.add(cosine / kPi * arriving.irradiance, arriving.transmitted);
      break;
    }
    case LightGroup::Kind::kOthers:
      for (const Light* const light : g.group.lights) {
        const LocalLight local = local_light(*light, p);
        const double cosine = glm::dot(local.towards, normal);
        if (!(cosine > 0)) continue;
        const double depth = ambient_light ? ambient_light->depth(p, local.towards, local.distance) : 0;
        lit.add(cosine / kPi * local.irradiance, beam(*light, local, depth, p).transmitted);
      }
      break;
    case LightGroup::Kind::kSky:
      if (ambient_light) lit.direct = ambient_light->onto(p, normal).sky * g.group.share();
      break;
    case LightGroup::Kind::kEmission:
      if (ambient_light) lit.direct = ambient_light->onto(p, normal).emitted;
      break;
    case LightGroup::Kind::kSurfaces:
      if (surface_light) lit.indirect = surface_light->onto(p, normal);
      break;
  }
  return lit;
}

Lit LitSurfaces::light_on(const ShadedPoint& at, const SolvedLight& g) const {
  Lit light;
  if (at.diffuse()) {
    light.add(at.bsdf.albedo, onto_diffuse(g, at.p, at.normal));
  } else if (g.group.sharp()) {
    const Beam arriving = beam(g, at.p);
    if (glm::dot(arriving.towards, at.normal) > 0 && arriving.transmitted.direct != dvec3(0))
      light.add(highlight(at, *g.group.lights[0]), arriving.transmitted);
  }
  return light;
}

dvec3 LitSurfaces::indirect_light_on(const ShadedPoint& at) const {
  if (!ambient_light || !at.diffuse()) return dvec3(0);
  return at.bsdf.albedo * ambient_light->onto(at.p, at.normal).scattered;
}

dvec3 LitSurfaces::reflected(const Ray& ray, const SurfaceHit& hit) const {
  const dvec3 p = Surfaces::leave(hit, ray.at(hit.t), -ray.d);
  const dvec3 normal = glm::dot(hit.shading, ray.d) > 0 ? -hit.shading : hit.shading;
  const Bsdf bsdf = surfaces->bsdf(hit);
  dvec3 sum(0);
  if (bsdf.kind == Bsdf::Kind::kDiffuse) {
    if (ambient_light) sum += ambient_light->onto(p, normal).scattered;
    for (const SolvedLight& g : groups) {
      const Lit lit = onto_diffuse(g, p, normal);
      sum += lit.direct + lit.indirect;
    }
    return bsdf.albedo * sum;
  }
  const Frame frame(normal);
  for (const SolvedLight& g : groups) {
    if (g.group.sharp()) {
      const Beam arriving = beam(g, p);
      if (glm::dot(arriving.towards, normal) > 0)
        sum += arriving.irradiance * (arriving.transmitted.direct + arriving.transmitted.indirect) *
               bsdf.value(in_frame(frame, -ray.d), in_frame(frame, arriving.towards), false);
    } else if (g.group.sky() && bsdf.kind == Bsdf::Kind::kConductor) {
      sum += bsdf.albedo * lights.environment()->radiance(glm::reflect(ray.d, normal)) * g.group.share();
    }
  }
  return sum;
}

}  // namespace brume
