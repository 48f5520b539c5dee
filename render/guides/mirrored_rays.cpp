#include "render/guides/mirrored_rays.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/golden_ratio.h"
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
constexpr int kLobeRaysOfMany = 4;     // of each, of a pixel that has many
constexpr double kSharpLobe = 0.1;     // alpha of metals whose pixels have more rays where they show edges
constexpr int kSquares = 4;            // along a side of a pixel, in which small lights are looked for
constexpr int kWide = 4;               // pixels along a side of squares that are asked first
constexpr int kSquareRays = 2;         // that look for them along a side of each
// Around where a corner's ray ends, over how far the other corners' end from there; where not all come there [rad].
constexpr double kSpread = 1.5, kUnknownSpread = 0.5;
constexpr double kFainter = 4;      // the corners' rays follow branches of so many times less weight
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
  Path path{&pixel, transmittance, peaks};
  path.shown = smooth ? Shown::kNone : Shown::kUngrouped;
  const int across = static_cast<int>(std::lround(1 / camera.cell));
  if (across == PixelRays::kMostAcross) {
    const ivec2 cell((camera.film - glm::floor(camera.film)) / camera.cell);
    path.camera_rays = across * across;
    path.camera_ray = cell.y * across + cell.x;
  }
  scatter(at, hit, path);
  if (smooth) show_lights(camera, hit.surface, path);
}

bool MirroredRays::Path::may_go_on() const {
  return bounces <= kMostBounces && faces <= kMostFaces;
}

template <class Visit>
void MirroredRays::branch(const ShadedPoint& at, const SurfaceHit& hit, const Path& path, const Visit& visit) const {
  const Bsdf& bsdf = at.bsdf;
  const dvec3 wo = at.to_frame(at.wo);
  const dvec3 outside = at.inside ? -hit.normal : hit.normal;
  const bool rough = !bsdf.delta(), glass = bsdf.kind == Bsdf::Kind::kDielectric;
  const bool seen = rough && path.bounces == 0 && path.faces == 0;
  const int rays = !seen ? 1 : path.camera_rays > 1 ? kLobeRaysOfMany : kLobeRays, all_rays = rays * path.camera_rays;
  const auto go_on = [&](const Bsdf::Sample& sample, double share) {
    const dvec3 d = glm::normalize(at.frame.to_world(sample.wi));
    if (glm::dot(d, outside) * sample.wi.z < 0) return;
    const dvec3 weight = share * sample.weight;
    Path next = path;
    next.throughput *= weight;
    next.largest *= max_component(weight);
    next.spread += rough ? 2 * bsdf.alpha() / std::sqrt(seen ? all_rays : 1) : 0;
    next.off_sharp_metal = seen && !glass && bsdf.alpha() < kSharpLobe;
    (sample.transmitted || at.inside ? next.faces : next.bounces)++;
    next.branches = 2 * next.branches + (sample.transmitted ? 1 : 0);
    if (rough || path.shown != Shown::kNone) next.shown = rough ? Shown::kUngrouped : Shown::kAll;
    visit(next, Ray{Surfaces::leave(hit, at.on, d), d});
  };
  for (int i = 0; i < rays; ++i) {
    dvec3 u(0);
    if (rays > 1) {
      const int k = i * path.camera_rays + path.camera_ray;
      u = {(k + 0.5) / all_rays, k * kGoldenRatio - std::floor(k * kGoldenRatio), 0};
    }
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

void MirroredRays::scatter(const ShadedPoint& at, const SurfaceHit& hit, const Path& path) {
  branch(at, hit, path, [&](const Path& next, const Ray& ray) {
    if (next.may_go_on())
      queue_.push_back({next, ray});
    else
      add(next, march_.context_.lights->environment()->radiance(ray.d), dvec3(0));
  });
}

MirroredRays::Met MirroredRays::meet(const Ray& ray) const {
  const std::optional<SurfaceHit> hit = march_.context_.surfaces->intersect(ray, kFar);
  const auto [light, distance] = march_.context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/false);
  return {hit, light, distance};
}

template <class End>
void MirroredRays::follow_smooth(const ShadedPoint& at, const SurfaceHit& hit, const Path& path, const End& end) const {
  branch(at, hit, path, [&](Path next, const Ray& ray) {
    if (!next.may_go_on()) return;
    const Met met = meet(ray);
    if (met.light || !met.hit) {
      end(next, ray, met);
      return;
    }
    const ShadedPoint there(*march_.context_.surfaces, ray, *met.hit);
    next.again = true;
    if (there.bsdf.delta()) follow_smooth(there, *met.hit, next, end);
  });
}

void MirroredRays::show_lights(const CameraSample& camera, uint32_t surface, Path path) {
  const ivec2 first = kWide * ivec2(glm::floor(camera.film / static_cast<double>(kWide)));
  if (!may_show_lights({kSquares * first, kSquares * kWide})) return;
  const int across = static_cast<int>(std::lround(kSquares * camera.cell));
  path.shown = Shown::kAll;
  path.throughput = dvec3(1.0 / (kSquareRays * kSquareRays * across * across));
  show_lights({ivec2(glm::round(static_cast<double>(kSquares) * (camera.film - 0.5 * camera.cell))), across}, camera,
              surface, path);
}

void MirroredRays::show_lights(const Square& square, const CameraSample& camera, uint32_t surface, const Path& path) {
  if (!may_show_lights(square)) return;
  if (square.side > 1) {
    const int half = square.side / 2;
    for (int i = 0; i < 4; ++i) show_lights({square.first + half * ivec2(i % 2, i / 2), half}, camera, surface, path);
    return;
  }
  const Surfaces& surfaces = *march_.context_.surfaces;
  for (int i = 0; i < kSquareRays * kSquareRays; ++i) {
    const dvec2 place = (dvec2(i % kSquareRays, i / kSquareRays) + 0.5) / static_cast<double>(kSquareRays);
    CameraSample sample = camera;
    sample.film = (dvec2(square.first) + place) / static_cast<double>(kSquares);
    const Ray ray = march_.rays_.ray(sample);
    const std::optional<SurfaceHit> own = surfaces.intersect(ray, kFar);
    if (!own || own->surface != surface) continue;
    follow_smooth(ShadedPoint(surfaces, ray, *own), *own, path, [&](const Path& end, const Ray& last, const Met& met) {
      add(end, lights_ahead(last, met, end.shown, /*marched=*/false), dvec3(0));
    });
  }
}

const std::vector<MirroredRays::CornerEnd>& MirroredRays::ends_at(const ivec2& corner) {
  const auto [place, fresh] = corners_.try_emplace({corner.x, corner.y});
  std::vector<CornerEnd>& ends = place->second;
  if (!fresh) return ends;
  const Ray ray = march_.rays_.ray({dvec2(corner) / static_cast<double>(kSquares)});
  const std::optional<SurfaceHit> hit = march_.rays_.first_hit(ray);
  if (!hit) return ends;
  const ShadedPoint at(*march_.context_.surfaces, ray, *hit);
  Path path;
  path.largest = kFainter;
  if (at.bsdf.delta())
    follow_smooth(at, *hit, path, [&](const Path& end, const Ray& last, const Met&) {
      ends.push_back({end.branches, last});
    });
  return ends;
}

// The rays through a square's corners stand for all of it, except through a lens or an open shutter, and in a wide
// square inside which smooth surfaces may begin.
bool MirroredRays::may_show_lights(const Square& square) {
  const Lights& lights = *march_.context_.lights;
  if (lights.finite().empty() &&
      std::all_of(lights.suns().begin(), lights.suns().end(), [](auto* sun) { return sun->delta(); }))
    return false;
  if (march_.rays_.blurred()) return true;
  std::array<const std::vector<CornerEnd>*, 4> corners;
  for (int i = 0; i < 4; ++i)
    corners[static_cast<size_t>(i)] = &ends_at(square.first + square.side * ivec2(i % 2, i / 2));
  for (const auto* const corner : corners)
    if (square.side > kSquares && corner->empty()) return true;
  for (const auto* const corner : corners)
    for (const CornerEnd& end : *corner) {
      double spread = 0;
      for (const auto* const other : corners) {
        const auto same =
            std::find_if(other->begin(), other->end(), [&](const CornerEnd& e) { return e.branches == end.branches; });
        spread =
            std::max(spread, same != other->end() ? kSpread * glm::distance(same->ray.d, end.ray.d) : kUnknownSpread);
      }
      if (light_within(end.ray, spread)) return true;
    }
  return false;
}

/// @param spread  around the ray [rad]
bool MirroredRays::light_within(const Ray& ray, double spread) const {
  const Lights& lights = *march_.context_.lights;
  for (const Sun* sun : lights.suns())
    if (!sun->delta() && glm::distance(ray.d, sun->axis()) < spread + std::sqrt(2 * sun->one_minus_cos())) return true;
  for (const FiniteLight* light : lights.finite()) {
    const LightPlace place = *light->place();
    const dvec3 to = place.centre - ray.o;
    const double distance = glm::length(to), sine = place.radius / distance;
    if (!(sine < 1)) return true;
    // Between directions to the middle and the rim.
    const double radius = std::sqrt(2 * (1 - std::sqrt(1 - sine * sine)));
    if (glm::distance(ray.d, to / distance) < spread + radius) return true;
  }
  return false;
}

void MirroredRays::follow(const MarchScene& scene) {
  std::vector<std::pair<Queued, Met>> met;
  while (!queue_.empty()) {
    met.clear();
    batch_.clear();
    while (!queue_.empty() && met.size() < kTogether) {
      const Queued& next = queue_.front();
      const Met there = meet(next.ray);
      GuideSums& sums = sums_[met.size()];
      sums.clear();
      MarchedRay& ray = scene.aim({next.ray, there.distance, sums}, march_.node_light_.lattice, batch_);
      if (!ray.misses()) {
        const double entry = ray.start / scene.steps.length + static_cast<double>(batch_.parts[ray.first_part].x);
        ray.stride = static_cast<float>(std::clamp(0.5 * next.path.spread * entry, 1.0, kLongestStep));
      }
      met.emplace_back(next, there);
      queue_.pop_front();
    }
    march_rays(scene, {march_.node_light_, nullptr, /*octaves=*/false}, batch_);
    for (size_t i = 0; i < met.size(); ++i) end(met[i].first, met[i].second, batch_.rays[i]);
  }
}

void MirroredRays::end(const Queued& queued, const Met& met, const MarchedRay& marched) {
  const auto& [path, ray] = queued;
  if (path.off_sharp_metal) {
    const auto& suns = march_.context_.lights->suns();
    const bool sun = std::any_of(suns.begin(), suns.end(),
                                 [&, &d = ray.d](const Sun* s) { return !s->delta() && s->radiance(d) != dvec3(0); });
    const int64_t there = met.light ? -3 : met.hit ? int64_t{met.hit->surface} : sun ? -2 : -1;
    path.pixel->mirrored_edge |= path.pixel->mirrored_end.value_or(there) != there;
    path.pixel->mirrored_end = there;
  }
  const double transmittance = marched.transmittance,
               peaks = std::max(0.0, static_cast<double>(marched.scaled_transmittance) - transmittance);
  if (met.light || !met.hit) {
    add(path, transmittance * lights_ahead(ray, met, path.shown, /*marched=*/true), dvec3(0));
  } else {
    const ShadedPoint at(*march_.context_.surfaces, ray, *met.hit);
    const dvec3 emitted = march_.context_.surfaces->emitted(*met.hit, !at.inside);
    const SurfaceLight::Around around = march_.surfaces_.around(at);
    dvec3 reflected = at.bsdf.albedo * around.scattered;
    for (size_t k = 0; k < march_.fields_.lights().size() && !at.bsdf.delta(); ++k) {
      const Lit lit = march_.surfaces_.light_on(at, around, *march_.fields_.lights()[k]);
      reflected += lit.direct + lit.indirect;
    }
    add(path, transmittance * emitted, transmittance * reflected + peaks * (emitted + reflected));
    if (!at.diffuse()) {
      Path next = path;
      next.throughput *= transmittance + peaks;
      next.again = true;
      scatter(at, *met.hit, next);
    }
  }
  if (marched.misses()) return;
  // What the media send.
  const GuideSums& sums = *marched.sums;
  dvec3 scattered = dvec3(sums.emission_once) + dvec3(sums.behind) + backwards(sums.plain, kOnce, ray.d) +
                    backwards(sums.scaled, kOften, ray.d) + sums.tinted_direct + sums.tinted_indirect;
  for (size_t k = 0; k < sums.groups.size() && !march_.media_[0].mixed_tints(); ++k)
    scattered += (sums.groups[k].single + sums.groups[k].forward) * march_.tint_.once() *
                 march_.fields_.lights()[k]->colour_in(march_.colour_);
  add(path, dvec3(sums.emission), scattered);
}

dvec3 MirroredRays::lights_ahead(const Ray& ray, const Met& met, Shown shown, bool marched) const {
  // How much of a light is shown.
  const auto share = [&](const Light* of) {
    if (shown == Shown::kNone) return 0.0;
    for (const auto& group : march_.fields_.lights()) {
      const SharpLight* const sharp = group->sharp();
      if (!sharp || &base_of(sharp->light()) != of) continue;
      if (shown == Shown::kUngrouped) return 0.0;
      if (!marched) return attenuation(sharp->at(ray.o).depth);
    }
    return 1.0;
  };
  if (met.light) {
    const double seen = share(met.light);
    return seen > 0 ? seen * met.light->radiance(ray, met.distance) : dvec3(0);
  }
  const Lights& lights = *march_.context_.lights;
  dvec3 sum(0);
  for (const InfiniteLight* far : lights.infinite()) {
    const bool environment = far == lights.environment();
    if (environment && !marched) continue;
    // A rough surface before has the highlights of its suns.
    const bool rest = environment && shown == Shown::kUngrouped;
    const dvec3 radiance = rest ? march_.fields_.sky_parts().radiance(ray.d) : far->radiance(ray.d);
    if (radiance != dvec3(0)) sum += (environment ? 1.0 : share(far)) * radiance;
  }
  return sum;
}

}  // namespace brume
