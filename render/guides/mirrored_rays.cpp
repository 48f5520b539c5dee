#include "render/guides/mirrored_rays.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/guides/ray_march.h"

namespace brume {
namespace {

constexpr size_t kTogether = 64;       // rays that are marched at once
constexpr int kMostBounces = 2;        // of a ray off the outside of metals and glass
constexpr int kMostFaces = 8;          // of glass, crossed or met from within
constexpr double kLeastWeight = 0.02;  // of a branch at a glass face; the other one has its light
constexpr int kLobeRays = 16;          // of a rough surface, seen by a camera ray
constexpr int kLightsAcross = 4;       // rays of a camera ray's square of film that look for small lights in mirrors
constexpr double kGoldenRatio = 0.6180339887498949;
constexpr double kLongestStep = 6;  // of rays that stand for many directions

}  // namespace

MirroredRays::MirroredRays(const GuideMarch& march) : march_(march) {
  for (size_t i = 0; i < kTogether; ++i) sums_.emplace_back(march.fields_.lights().size());
}

void MirroredRays::add(const Path& path, const dvec3& direct, const dvec3& indirect) const {
  const dvec3 seen = path.throughput * path.transmittance;
  (path.again ? path.pixel->mirrored_indirect : path.pixel->mirrored) += seen * direct;
  path.pixel->mirrored_indirect += seen * indirect;
  path.pixel->behind += vec3(path.throughput * path.peaks * (direct + indirect));
}

void MirroredRays::start(const CameraSample& camera, const ShadedPoint& at, const SurfaceHit& hit, double transmittance,
                         double peaks, GuideSums& pixel) {
  const bool smooth = at.bsdf.delta();
  const Lights& lights = *march_.context_.lights;
  Path path{&pixel, transmittance, peaks};
  path.shown = smooth ? Shown::kNone : Shown::kUngrouped;
  scatter(at, hit, path);
  if (!smooth || (lights.suns().empty() && lights.finite().empty())) return;
  // Small lights, by rays that meet surfaces alone.
  constexpr int kRays = kLightsAcross * kLightsAcross;
  path.shown = Shown::kAll;
  path.only_lights = true;
  path.throughput = dvec3(1.0 / kRays);
  for (int i = 0; i < kRays; ++i) {
    const dvec2 off = (dvec2(i % kLightsAcross, i / kLightsAcross) + 0.5) / static_cast<double>(kLightsAcross) - 0.5;
    CameraSample sample = camera;
    sample.film += camera.cell * off;
    const Ray ray = march_.rays_.ray(sample);
    const std::optional<SurfaceHit> own = march_.context_.surfaces->intersect(ray, kFar);
    if (own && own->surface == hit.surface) scatter(ShadedPoint(*march_.context_.surfaces, ray, *own), *own, path);
  }
}

// Queues the lobe's directions, or both of smooth glass.
void MirroredRays::scatter(const ShadedPoint& at, const SurfaceHit& hit, const Path& path) {
  const Bsdf& bsdf = at.bsdf;
  const dvec3 wo = at.to_frame(at.wo);
  const dvec3 outside = at.inside ? -hit.normal : hit.normal;
  const bool rough = !bsdf.delta(), glass = bsdf.kind == Bsdf::Kind::kDielectric;
  const int rays = rough && path.bounces == 0 && path.faces == 0 ? kLobeRays : 1;
  const auto go_on = [&](const Bsdf::Sample& sample, double share) {
    const dvec3 d = glm::normalize(at.frame.to_world(sample.wi));
    if (glm::dot(d, outside) * sample.wi.z < 0) return;
    const dvec3 weight = share * sample.weight;
    Path next = path;
    next.throughput *= weight;
    next.largest *= max_component(weight);
    next.spread += rough ? 2 * bsdf.alpha() / std::sqrt(rays) : 0;
    (sample.transmitted || at.inside ? next.faces : next.bounces)++;
    if (!path.only_lights && (rough || path.shown != Shown::kNone))
      next.shown = rough ? Shown::kUngrouped : Shown::kAll;
    if (next.bounces <= kMostBounces && next.faces <= kMostFaces)
      queue_.push_back({next, {Surfaces::leave(hit, at.on, d), d}});
    else if (!path.only_lights)
      add(next, march_.context_.lights->environment()->radiance(d), dvec3(0));
  };
  for (int i = 0; i < rays; ++i) {
    dvec3 u(0);
    if (rays > 1) u = {(i + 0.5) / rays, i * kGoldenRatio - std::floor(i * kGoldenRatio), 0};
    Bsdf::Sample sample;
    if (!glass) {
      if (bsdf.sample(wo, at.inside, u, sample)) go_on(sample, 1.0 / rays);
      continue;
    }
    // Both branches, weighted by the reflectance of the facet.
    const bool reflects = bsdf.sample(wo, at.inside, u, sample);
    const dvec3 facet = glm::normalize(wo + (reflects ? sample.wi : wo));
    double reflected = fresnel_dielectric(glm::dot(wo, facet), at.inside ? 1 / bsdf.ior : bsdf.ior);
    if (path.largest * reflected / rays < kLeastWeight && at.inside) reflected = 0;
    if (path.largest * (1 - reflected) / rays < kLeastWeight && reflected > 0.5) reflected = 1;
    if (reflects && reflected > 0) go_on(sample, reflected / rays);
    u.z = 1 - 1e-12;
    if (reflected < 1 && bsdf.sample(wo, at.inside, u, sample) && sample.transmitted)
      go_on(sample, (1 - reflected) / rays);
  }
}

void MirroredRays::follow(const MarchScene& scene) {
  const PathContext& context = march_.context_;
  struct Met {
    Queued queued;
    std::optional<SurfaceHit> hit;
    const FiniteLight* light;
    double distance;
  };
  std::vector<Met> met;
  while (!queue_.empty()) {
    met.clear();
    batch_.clear();
    while (!queue_.empty() && met.size() < kTogether) {
      const Queued& next = queue_.front();
      const std::optional<SurfaceHit> hit = context.surfaces->intersect(next.ray, kFar);
      const auto [light, distance] = context.lights->nearest(next.ray, hit ? hit->t : kFar, /*seen=*/false);
      GuideSums& sums = sums_[met.size()];
      sums.clear();
      if (next.path.only_lights) {
        batch_.rays.emplace_back();
      } else if (MarchedRay& ray = scene.aim(next.ray, distance, 1, 0, march_.node_light_.lattice, sums, batch_);
                 !ray.misses()) {
        const double entry = ray.start / scene.steps.length + static_cast<double>(batch_.parts[ray.first_part].x);
        ray.stride = static_cast<float>(std::clamp(0.5 * next.path.spread * entry, 1.0, kLongestStep));
      }
      met.push_back({next, hit, light, distance});
      queue_.pop_front();
    }
    march_rays(scene, {march_.node_light_, nullptr, /*octaves=*/false}, batch_);
    for (size_t i = 0; i < met.size(); ++i)
      end(met[i].queued, met[i].hit, met[i].light, met[i].distance, batch_.rays[i]);
  }
}

void MirroredRays::end(const Queued& queued, const std::optional<SurfaceHit>& hit, const FiniteLight* light,
                       double distance, const MarchedRay& marched) {
  const auto& [path, ray] = queued;
  const double transmittance = marched.transmittance,
               peaks = std::max(0.0, static_cast<double>(marched.scaled_transmittance) - transmittance);
  if (light || !hit) {
    add(path, transmittance * lights_ahead(ray, light, distance, path), dvec3(0));
  } else {
    const ShadedPoint at(*march_.context_.surfaces, ray, *hit);
    if (path.only_lights && !at.bsdf.delta()) return;
    if (!path.only_lights) {
      const dvec3 emitted = march_.context_.surfaces->emitted(hit->surface, !at.inside);
      const SurfaceLight::Around around = march_.surfaces_.around(at);
      dvec3 reflected = at.bsdf.albedo * around.scattered;
      for (size_t k = 0; k < march_.fields_.lights().size() && !at.bsdf.delta(); ++k) {
        const Lit lit = march_.surfaces_.light_on(at, around, *march_.fields_.lights()[k]);
        reflected += lit.direct + lit.indirect;
      }
      add(path, transmittance * emitted, transmittance * reflected + peaks * (emitted + reflected));
    }
    if (!at.diffuse()) {
      Path next = path;
      next.throughput *= transmittance + peaks;
      next.again = true;
      scatter(at, *hit, next);
    }
  }
  if (path.only_lights || marched.misses()) return;
  // What the media send.
  const GuideSums& sums = *marched.sums;
  dvec3 scattered = dvec3(sums.emission_once) + dvec3(sums.behind) + backwards(sums.plain, kOnce, ray.d) +
                    backwards(sums.scaled, kOften, ray.d) + sums.tinted_direct + sums.tinted_indirect;
  for (size_t k = 0; k < sums.groups.size() && !march_.media_[0].mixed_tints(); ++k)
    scattered += (sums.groups[k].single + sums.groups[k].forward) * march_.tint_.once() *
                 march_.fields_.lights()[k]->colour_in(march_.colour_);
  add(path, dvec3(sums.emission), scattered);
}

dvec3 MirroredRays::lights_ahead(const Ray& ray, const FiniteLight* light, double distance, const Path& path) const {
  // How much of a light is shown.
  const auto share = [&](const Light* of) {
    if (path.shown == Shown::kNone) return 0.0;
    for (const auto& group : march_.fields_.lights()) {
      const SharpLight* const sharp = group->sharp();
      if (!sharp || &base_of(sharp->light()) != of) continue;
      if (path.shown == Shown::kUngrouped) return 0.0;
      // Media were not marched.
      if (path.only_lights) return attenuation(sharp->at(ray.o).depth);
    }
    return 1.0;
  };
  if (light) {
    const double shown = share(light);
    return shown > 0 ? shown * light->radiance(ray, distance) : dvec3(0);
  }
  const Lights& lights = *march_.context_.lights;
  dvec3 sum(0);
  for (const InfiniteLight* far : lights.infinite()) {
    const bool environment = far == lights.environment();
    if (environment && path.only_lights) continue;
    // A rough surface before has the highlights of its suns.
    const bool rest = environment && path.shown == Shown::kUngrouped;
    const dvec3 radiance = rest ? march_.fields_.sky_parts().radiance(ray.d) : far->radiance(ray.d);
    if (radiance != dvec3(0)) sum += (environment ? 1.0 : share(far)) * radiance;
  }
  return sum;
}

}  // namespace brume
