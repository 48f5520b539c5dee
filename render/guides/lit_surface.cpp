#include "render/guides/lit_surface.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "base/golden_ratio.h"
#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/guides/light_rim.h"
#include "render/guides/media_line.h"
#include "render/guides/sky_light.h"
#include "render/transport/estimator.h"

namespace brume {
namespace {

constexpr double kDark = 50;  // optical depth behind which nothing is lit
// Depths by the nodes between which media are looked up voxel by voxel, and how often at most on one way.
constexpr double kClear = 0.01, kShadow = 6;
constexpr int kMostLooks = 128;
constexpr int kHighlightAcross = 4;  // points of a light, and as many directions of a lobe

constexpr double kWidestLobe = 0.6;  // alpha of a metal that is seen by few rays: wider lobes lose light
constexpr double kSharpGloss = 0.4;  // roughness of coats below which they are seen to mirror

// The reflected light of a lamp or sun by points of it and by directions of the lobe, each weighted by the balance
// heuristic, as the tracer does it.
dvec3 highlight(const ShadedPoint& at, const KnownLight& known) {
  constexpr int kPoints = kHighlightAcross * kHighlightAcross;
  const dvec3 wo = at.to_frame(at.wo);
  const Light& light = base_of(known);
  const bool met = has_extent(known);
  dvec3 sum(0);
  for (int i = 0; i < kPoints; ++i) {
    const dvec2 u = (dvec2(i % kHighlightAcross, i / kHighlightAcross) + 0.5) / static_cast<double>(kHighlightAcross);
    const LightSample sample = light.sample(at.p, u);
    if (!(sample.pdf > 0)) continue;
    const dvec3 wi = at.to_frame(sample.wi);
    if (!(wi.z > 0)) continue;
    const double weight = !met ? 1 : balance(sample.pdf, at.bsdf.pdf(wo, wi, at.inside));
    sum += sample.radiance * at.bsdf.value(wo, wi, at.inside) * (weight / sample.pdf / kPoints);
  }
  if (!met) return sum;
  for (int i = 0; i < kPoints; ++i) {
    Bsdf::Sample sample;
    const dvec3 u((i + 0.5) / kPoints, i * kGoldenRatio - std::floor(i * kGoldenRatio), 0);
    if (!at.bsdf.sample(wo, at.inside, u, sample)) continue;
    const std::optional<MetLight> there = met_by({at.p, at.frame.to_world(sample.wi)}, known);
    if (!there || there->radiance == dvec3(0)) continue;
    dvec3 weight = sample.weight;
    if (at.bsdf.kind == Bsdf::Kind::kDielectric)
      weight *=
          fresnel_dielectric(glm::dot(wo, glm::normalize(wo + sample.wi)), at.inside ? 1 / at.bsdf.ior : at.bsdf.ior);
    sum += there->radiance * weight * (balance(sample.pdf, there->pdf) / kPoints);
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
  if (bsdf.kind != Bsdf::Kind::kCoated) return;
  if (bsdf.roughness < kSharpGloss) gloss = bsdf.gloss();
  bsdf = gloss ? bsdf.base_seen(glm::dot(wo, normal)) : bsdf.evened();
}

dvec3 LitSurfaces::open(const Ray& shadow, double distance, const Light& from) const {
  return lights.blocked(shadow, distance, &from) ? dvec3(0) : surfaces->passage(shadow, distance).light;
}

// What surfaces leave of a light at a point: its middle if it is small, else the mean over it.
dvec3 LitSurfaces::unshadowed(const KnownLight& source, const ArrivingLight& light, const dvec3& p) const {
  const Light& from = base_of(source);
  if (!has_extent(source)) return open({p, light.towards}, light.distance, from);
  if (const std::optional<dvec3> alike = left_alike(source, *this, p)) return *alike;
  dvec3 sum(0);
  for (int i = 0; i < kPenumbraAcross * kPenumbraAcross; ++i) {
    const dvec2 place = (dvec2(i % kPenumbraAcross, i / kPenumbraAcross) + 0.5) / static_cast<double>(kPenumbraAcross);
    const LightSample s = from.sample(p, place);
    sum += open({p, s.wi}, std::min(s.distance, kFar), from);
  }
  return sum / static_cast<double>(kPenumbraAcross * kPenumbraAcross);
}

Lit LitSurfaces::shares(const dvec3& p, const dvec3& towards, double distance) const {
  const double scaled = depth(p, towards, distance), straight = attenuation(scaled / scale);
  return {dvec3(straight), dvec3(attenuation(scaled) - straight)};
}

// Nodes lie several voxels apart: the edges of shadows are sharper than they know.
double LitSurfaces::depth(const dvec3& p, const dvec3& towards, double distance) const {
  const double by_nodes = ambient_light->depth(p, towards, distance);
  if (!media || media->instances() || !(by_nodes > kClear && by_nodes < kShadow)) return by_nodes;
  static thread_local std::vector<std::pair<double, double>> parts;
  const Ray ray{p, towards};
  media->intervals(ray, distance, parts, /*uneven=*/true);
  double length = 0, exact = by_nodes;
  for (const auto& [t0, t1] : parts) length += t1 - t0;
  const double longest = std::max(media->voxel(), length / kMostLooks);
  MediaLine line(*media, colour);
  line.follow(ray);
  for (const auto& [t0, t1] : parts) {
    const int steps = std::max(1, static_cast<int>(std::ceil((t1 - t0) / longest)));
    const double step = (t1 - t0) / steps;
    double sum = 0;
    for (int i = 0; i < steps; ++i) sum += line.at(t0 + (i + 0.5) * step).sigma_t;
    exact += scale * step * sum - ambient_light->depth(ray.at(t0), towards, t1 - t0);
  }
  return std::max(exact, 0.0);
}

ArrivingLight LitSurfaces::arriving(const SharpLight& sharp, const dvec3& p) const {
  ArrivingLight light = sharp.at(p);
  if (!sharp.sun()) light.depth = depth(p, light.towards, light.distance) / scale;
  return light;
}

Lit LitSurfaces::transmitted(const KnownLight& source, const ArrivingLight& light, const dvec3& p) const {
  const double scaled = scale * light.depth;
  if (!(scaled < kDark)) return {};
  const dvec3 open = unshadowed(source, light, p);
  const double straight = attenuation(scaled / scale);
  return {straight * open, (attenuation(scaled) - straight) * open};
}

Lit LitSurfaces::light_on(const ShadedPoint& at, const SurfaceLight::Around& around, const GuideLight& group) const {
  Lit lit;
  if (at.diffuse()) {
    lit.add(at.bsdf.albedo, group.onto(*this, around, at.p, at.normal));
  } else if (const SharpLight* const sharp = group.sharp()) {
    const ArrivingLight light = arriving(*sharp, at.p);
    if (!(glm::dot(light.towards, at.normal) > 0)) return lit;
    if (const Lit shares = transmitted(sharp->light(), light, at.p); shares.direct != dvec3(0))
      lit.add(highlight(at, sharp->light()), shares);
  }
  return lit;
}

dvec3 LitSurfaces::reflected(const Ray& ray, const SurfaceHit& hit, double spread, std::span<dvec3> of_groups) const {
  std::fill(of_groups.begin(), of_groups.end(), dvec3(0));
  const auto add_to_group = [&](const GuideLight& of, const dvec3& light) {
    if (of.group_number >= 0 && !of_groups.empty()) of_groups[static_cast<size_t>(of.group_number)] += light;
  };
  const ShadedPoint at(*surfaces, ray, hit);
  dvec3 sum(0);
  if (at.diffuse()) {
    const SurfaceLight::Around all = around(at, of_groups);
    sum += all.scattered;
    for (const auto& group : groups) {
      const Lit lit = group->onto(*this, all, at.p, at.normal);
      sum += lit.direct + lit.indirect;
      add_to_group(*group, lit.direct + lit.indirect);
    }
    for (dvec3& light : of_groups) light *= at.bsdf.albedo;
    return at.bsdf.albedo * sum;
  }
  Bsdf bsdf = at.bsdf;
  if (bsdf.kind == Bsdf::Kind::kConductor && spread > 0)
    bsdf.roughness = std::sqrt(std::min(std::hypot(bsdf.alpha(), spread), kWidestLobe));
  for (const auto& group : groups) {
    if (const SharpLight* const sharp = group->sharp()) {
      const ArrivingLight light = arriving(*sharp, at.p);
      if (!(glm::dot(light.towards, at.normal) > 0)) continue;
      const Lit shares = transmitted(sharp->light(), light, at.p);
      const dvec3 own = light.irradiance * (shares.direct + shares.indirect) *
                        bsdf.value(at.to_frame(at.wo), at.to_frame(light.towards), false);
      sum += own;
      add_to_group(*group, own);
    } else if (group->sky() && at.bsdf.kind == Bsdf::Kind::kConductor) {
      const dvec3 mirrored = glm::reflect(ray.d, at.normal);
      if (surfaces->intersect({at.p, mirrored}, kFar)) continue;
      const dvec3 own = at.bsdf.albedo * sky.radiance(mirrored) * group->sky()->share();
      sum += own;
      add_to_group(*group, own);
    }
  }
  return sum;
}

}  // namespace brume
