// What surfaces that guides see reflect: every light's irradiance through the media, the sky, highlights.

#include <cmath>

#include "render/guides/guide_march.h"
#include "render/guides/media_line.h"
#include "render/transport/estimator.h"

namespace brume {
namespace {

constexpr int kHighlightAcross = 4;  // points of a light, and as many directions of a lobe
constexpr double kGoldenRatio = 0.6180339887498949;

vec3 tinted(const dvec3& colour, double value) {
  return vec3(colour * value);
}

}  // namespace

GuideMarch::Shaded GuideMarch::shaded(const Ray& ray, const SurfaceHit& hit) const {
  const bool front = glm::dot(hit.normal, ray.d) < 0;
  // As the tracer: the shading normal's angles, but the geometry's side.
  const dvec3 outside = front ? hit.normal : -hit.normal, smooth = front ? hit.shading : -hit.shading;
  const dvec3 normal = glm::dot(-ray.d, smooth) > 1e-4 ? smooth : outside;
  const dvec3 p = ray.at(hit.t);
  return {p, Surfaces::leave(hit, p, -ray.d), normal, -ray.d, !front, context_.surfaces->bsdf(hit), Frame(normal)};
}

// Lit by every light's irradiance through the medium, and by the sky; metals and glass show what they mirror.
void GuideMarch::add_surface(const Eye& eye, const Ray& ray, const SurfaceHit& hit, const Passed& passed,
                             const GuideMedia& media, MediaLine& line, GuideSums& sums) const {
  const Shaded at = shaded(ray, hit);
  const double straight = passed.straight;
  sums.normal += tinted(at.normal, straight);
  sums.surface_albedo += tinted(at.bsdf.albedo, straight);
  sums.surface_depth += straight * (hit.t - reference_depth_);
  sums.material[static_cast<int>(at.bsdf.kind)] += static_cast<float>(straight);
  sums.background += tinted(context_.surfaces->emitted(hit.surface, !at.inside), straight);
  dvec3 indirect = indirect_light_on(at), leaving(0);
  for (size_t k = 0; k < sums.groups.size() && !at.bsdf.delta(); ++k) {
    const Lit light = light_on(at, k);
    sums.surface[k] += tinted(light.direct, straight);
    leaving += light.direct;
    indirect += light.indirect;
  }
  sums.indirect += tinted(indirect, straight);
  leaving += indirect;
  if (at.bsdf.kind != Bsdf::Kind::kDiffuse) {
    const Seen seen = mirrored(eye, at, hit, media, line);
    sums.mirrored += tinted(seen.straight, straight);
    sums.mirrored_indirect += tinted(seen.scattered, straight);
    leaving += seen.straight + seen.scattered;
  }
  sums.behind += tinted(leaving, passed.peaks);
}

Surroundings GuideMarch::surroundings() const {
  return {fields_.lattice(), fields_.scaled_extinction(), *context_.lights,       *context_.surfaces,
          colour_,           fields_.ambient_light(),     fields_.surface_light()};
}

dvec3 GuideMarch::indirect_light_on(const Shaded& at) const {
  const AmbientLight* const ambient = fields_.ambient_light();
  if (!ambient || at.bsdf.kind != Bsdf::Kind::kDiffuse) return dvec3(0);
  return at.bsdf.albedo * ambient->onto(at.p, at.normal).scattered;
}

Lit GuideMarch::light_on(const Shaded& at, size_t group) const {
  const SolvedLight& g = fields_.lights()[group];
  Lit light;
  if (at.bsdf.kind == Bsdf::Kind::kDiffuse) {
    light.add(at.bsdf.albedo, diffuse_light(g, surroundings(), at.p, at.normal));
  } else if (g.group.sharp()) {
    const Beam beam = beam_at(g, surroundings(), at.p);
    if (glm::dot(beam.towards, at.normal) > 0 && beam.passed.direct != dvec3(0))
      light.add(highlight(at, *g.group.lights[0]), beam.passed);
  }
  return light;
}

// The reflected light of a lamp or sun by points of it and by directions of the lobe, each weighted by the balance
// heuristic, as the tracer does it.
dvec3 GuideMarch::highlight(const Shaded& at, const Light& light) const {
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

}  // namespace brume
