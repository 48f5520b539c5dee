// What metals and glass show: camera rays that go on from them, to fixed directions, until they meet something else.

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/attenuation.h"
#include "render/guides/forward_peak.h"
#include "render/guides/guide_march.h"
#include "render/guides/media_line.h"
#include "render/transport/estimator.h"

namespace brume {
namespace {

constexpr double kFar = 1e30;
constexpr int kMostBounces = 2;        // of a ray off the outside of metals and glass
constexpr int kMostFaces = 8;          // of glass, crossed or met from within
constexpr double kLeastWeight = 0.02;  // of a branch at a glass face; the other one has its light
constexpr int kLobeRays = 16;          // of a rough surface, seen by a camera ray
constexpr int kLightsAcross = 4;       // rays of a camera ray's square of film that look for small lights in mirrors
constexpr double kGoldenRatio = 0.6180339887498949;
constexpr double kLightSteps = 2, kLightThickness = 0.12, kOpaque = 2e-3;  // as of camera rays
constexpr double kLongestStep = 6;

/// Of nodes with kCount numbers each, linear between them.
template <size_t kCount>
std::array<float, kCount> interpolate_nodes(const Lattice& lattice, const NodeValues& values, const dvec3& world) {
  const dvec3 p = glm::clamp(lattice.to_lattice(world), dvec3(0), dvec3(lattice.n - 1));
  const ivec3 i = glm::min(ivec3(p), lattice.n - 2);
  const vec3 f(p - dvec3(i)), e = 1.0f - f;
  const size_t y = static_cast<size_t>(lattice.n.z), x = y * static_cast<size_t>(lattice.n.y);
  const float* const node = values.data() + (i.x * x + i.y * y + i.z) * kCount;
  std::array<float, kCount> sum{};
  for (size_t corner = 0; corner < 8; ++corner) {
    const float weight = (corner & 1 ? f.x : e.x) * (corner & 2 ? f.y : e.y) * (corner & 4 ? f.z : e.z);
    const float* const at = node + ((corner & 1 ? x : 0) + (corner & 2 ? y : 0) + (corner & 4 ? 1 : 0)) * kCount;
    for (size_t m = 0; m < kCount; ++m) sum[m] += weight * at[m];
  }
  return sum;
}

// Moments (mean, and flux along x, y, z) of light scattered once and more often, each red, green and blue.
constexpr size_t kOnce = 0, kOften = 12, kLightCount = 24;

}  // namespace

/// How a ray came to be.
struct GuideMarch::Way {
  /// Which lights it shows: those of groups of their own are told apart where a surface before has their highlights,
  /// or where small ones are looked for by more rays.
  enum class Shown { kNone, kUngrouped, kAll } shown = Shown::kAll;
  bool only_lights = false;
  int bounces = 0, faces = 0;
  double weight = 1;  ///< the largest colour's
  double spread = 0;  ///< of what it stands for [rad]
};

void GuideMarch::gather_light(const Task& task) {
  node_light_ = {};
  if (!context_.surfaces) return;
  bool any = false;
  for (uint32_t i = 0; i < context_.surfaces->count(); ++i)
    any = any || context_.surfaces->settings(i).material != "diffuse";
  if (!any) return;
  const Lattice& coarse = fields_.coarse_lattice();
  const Lattice& fine = fields_.lattice();
  const ivec3 n = coarse.n;
  const auto& directions = ScatteringSolver::directions();
  node_light_ = NodeValues(static_cast<size_t>(n.x) * n.y * n.z * kLightCount);
  parallel_for(n.x, quiet(task), [&](int x) {
    for (int y = 0; y < n.y; ++y)
      for (int z = 0; z < n.z; ++z) {
        float* const out = node_light_.data() + ((static_cast<size_t>(x) * n.y + y) * n.z + z) * kLightCount;
        const dvec3 p = coarse.node(x, y, z);
        const auto add = [&](size_t first, double mean, const dvec3& flux, const dvec3& colour) {
          for (size_t moment = 0; moment < 4; ++moment)
            for (int c = 0; c < 3; ++c)
              out[first + 3 * moment + static_cast<size_t>(c)] +=
                  static_cast<float>(colour[c] * (moment == 0 ? mean : flux[static_cast<int>(moment) - 1]));
        };
        const auto add_moments = [&](size_t first, const Lattice& lattice, const Moments& light, const dvec3& colour) {
          const NodeWeights around(lattice, p);
          const auto at = [&](size_t m) { return static_cast<double>(around(light[m])); };
          add(first, at(0), {at(1), at(2), at(3)}, colour);
        };
        const GuideMedia::Point point = media_[0].at(p, colour_);
        const OrderTint tints = media_[0].mixed_tints() ? OrderTint(point.tint) : tint_;
        std::vector<double> arriving;  // share of the sky's light, by its direction
        if (!fields_.sky().empty()) {
          const NodeWeights around(fine, p);
          for (size_t d = 0; d < directions.size(); ++d)
            arriving.push_back(around.mean([&](size_t node) { return fields_.sky()(node, d); }));
        }
        for (const SolvedLight& g : fields_.lights()) {
          const dvec3 colour = colour_of(g);
          for (size_t order = 0; order < g.orders.size(); ++order)
            add_moments(kOften, order < SolvedLight::kFineGuides ? fine : coarse, g.orders[order],
                        colour * tints.of_guide(order));
          if (!g.once[0].empty()) add_moments(kOnce, fine, g.once, colour * tints.once());
          if (g.incoming.empty()) continue;
          double mean = 0;
          dvec3 flux(0);
          for (size_t d = 0; d < directions.size(); ++d) {
            const double light = g.incoming[d] * arriving[d];
            mean += light;
            flux += light * directions[d];
          }
          const double share = point.albedo / static_cast<double>(directions.size());
          add(kOnce, share * mean, 3 * point.g * share * flux, colour * tints.once());
        }
      }
  });
}

// As march(), but that all light is added up, and of many times scattered light there is a coarse table for all eyes.
GuideMarch::Passed GuideMarch::see_media(const Ray& ray, const GuideMedia& media, MediaLine& line, double t_max,
                                         double spread, Seen& seen) const {
  static thread_local std::vector<std::pair<double, double>> parts;
  media.intervals(ray, t_max, parts);
  if (parts.empty()) return {};
  line.follow(ray);
  const bool emits = !media.emissions().empty();
  const double scale = fields_.scaled_extinction();
  double passed = 1, passed_scaled = 1;
  double depth = 0;
  // Sums over the steps that share one look-up of light.
  double w = 0, scaled = 0, thickness_sum = 0, distance = 0, depth_sum = 0, albedo = 0, g_sum = 0;
  dvec3 tint(0);
  const auto light_of = [&] {
    if (!(thickness_sum > 0)) return;
    const dvec3 p = in_light(media, ray.at(distance / thickness_sum));
    const auto light = interpolate_nodes<kLightCount>(fields_.coarse_lattice(), node_light_, p);
    const auto towards_eye = [&](size_t first) {
      dvec3 sum;
      for (size_t c = 0; c < 3; ++c) {
        const float* const m = light.data() + first + c;
        sum[static_cast<int>(c)] = std::max(0.0, m[0] - (ray.d.x * m[3] + ray.d.y * m[6] + ray.d.z * m[9]));
      }
      return sum;
    };
    seen.scattered += w * towards_eye(kOnce) + scaled * towards_eye(kOften);
    const double g_mean = g_sum / thickness_sum;
    for (const SolvedLight& g : fields_.lights()) {
      if (!g.group.sharp() || !(albedo > 0)) continue;
      double irradiance, tau, arriving, extent = 1;
      dvec3 towards;
      if (g.group.sun) {
        towards = g.group.sun->axis();
        irradiance = in_colour(g.group.sun->irradiance(), colour_);
        tau = g.sun[time_of(media)].at(ray.at(distance / thickness_sum));
        arriving = attenuation(tau);
      } else {
        const LocalLight local = local_light(*g.group.lights[0], p);
        towards = local.towards;
        irradiance = in_colour(local.irradiance, colour_);
        tau = interpolated(fields_.lattice(), g.depth, p);
        arriving = local.transmittance(tau);
        extent = local.mean_cosine();
      }
      if (!g.visible.empty()) irradiance *= interpolated(fields_.lattice(), g.visible, p);
      const double cosine = glm::dot(towards, ray.d), peak = (1 - scale) * (tau + depth_sum / thickness_sum);
      const double phase = phase_value(media, cosine, g_mean, extent) + ForwardPeak(g_mean, cosine).repeated(peak);
      seen.scattered += w * irradiance * albedo / thickness_sum * phase * arriving * (tint / albedo) * colour_of(g);
    }
    w = scaled = thickness_sum = distance = depth_sum = albedo = g_sum = 0;
    tint = dvec3(0);
  };
  for (const auto& [begin, end] : parts) {
    double t = std::floor(begin / step_) * step_, looked = t;
    while (t < end && passed > kOpaque) {
      const double length = std::clamp(0.5 * spread * t, step_, kLongestStep * step_), middle = t + 0.5 * length;
      t += length;
      if (middle > t_max) break;
      const GuideMedia::Point point = line.at(middle);
      const double thickness = point.sigma_t * length;
      const double q = attenuation(thickness), q_scaled = attenuation(thickness * scale), share = passed * (1 - q);
      if (emits) {
        const double straight = thickness > 0 ? share / point.sigma_t : passed * length;
        const double peaks = thickness > 0 ? passed_scaled * (1 - q_scaled) / (point.sigma_t * scale) - straight
                                           : (passed_scaled - passed) * length;
        const dvec3 emission = media.emission(ray.at(middle));
        seen.straight += straight * emission;
        seen.scattered += std::max(0.0, peaks) * emission;
      }
      if (!(thickness > 0)) continue;
      if (thickness_sum > kLightThickness || t - looked > kLightSteps * length) {
        light_of();
        looked = t - length;
      }
      w += share;
      scaled += passed_scaled * (1 - q_scaled);
      thickness_sum += thickness;
      distance += thickness * middle;
      depth_sum += thickness * (depth + 0.5 * thickness);
      depth += thickness;
      albedo += thickness * point.albedo;
      tint += thickness * point.albedo * (colour_ == kGrey ? point.tint : dvec3(1));
      g_sum += thickness * point.g;
      passed *= q;
      passed_scaled *= q_scaled;
    }
  }
  light_of();
  return {passed, std::max(0.0, passed_scaled - passed)};
}

// Of a ray that meets no surface before t_end: the light that it ends on there, or everything infinitely far.
dvec3 GuideMarch::lights_ahead(const Ray& ray, const FiniteLight* light, double distance, const Way& way) const {
  const auto shown = [&](const Light* of, double& left) {
    if (way.shown == Way::Shown::kNone) return false;
    for (const SolvedLight& g : fields_.lights()) {
      if (!g.group.sharp() || g.group.lights[0] != of) continue;
      if (way.shown == Way::Shown::kUngrouped) return false;
      // Media were not marched.
      if (way.only_lights)
        left = attenuation(g.group.sun ? g.sun_in_middle().at(ray.o) : interpolated(fields_.lattice(), g.depth, ray.o));
    }
    return true;
  };
  double left = 1;
  if (light) return shown(light, left) ? left * light->radiance(ray, distance) : dvec3(0);
  dvec3 sum(0);
  for (const InfiniteLight* far : context_.lights->infinite()) {
    if (far == context_.lights->environment()) {
      if (!way.only_lights) sum += far->radiance(ray.d);
      continue;
    }
    const dvec3 radiance = far->radiance(ray.d);
    left = 1;
    if (radiance != dvec3(0) && shown(far, left)) sum += left * radiance;
  }
  return sum;
}

GuideMarch::Seen GuideMarch::look(const Ray& ray, const GuideMedia& media, MediaLine& line, const Way& way) const {
  const std::optional<SurfaceHit> hit = context_.surfaces->intersect(ray, kFar);
  const auto [light, t_end] = context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/false);
  Seen seen;
  const Passed passed = way.only_lights ? Passed{} : see_media(ray, media, line, t_end, way.spread, seen);
  Seen end;
  if (light || !hit) {
    end.straight = lights_ahead(ray, light, t_end, way);
  } else {
    const Shaded at = shaded(ray, *hit);
    if (way.only_lights && !at.bsdf.delta()) return seen;
    if (!way.only_lights) {
      end.straight = context_.surfaces->emitted(hit->surface, !at.inside);
      for (size_t k = 0; k < fields_.lights().size() && !at.bsdf.delta(); ++k) {
        const Lit lit = light_on(at, k);
        end.scattered += lit.direct + lit.indirect;
      }
      end.scattered += indirect_light_on(at);
    }
    if (at.bsdf.kind != Bsdf::Kind::kDiffuse) {
      const Seen behind = bounce(at, *hit, media, line, way);
      end.scattered += behind.straight + behind.scattered;
    }
  }
  seen.add(dvec3(passed.straight), end);
  if (hit && !light) seen.scattered += passed.peaks * (end.straight + end.scattered);
  return seen;
}

// The lobe's directions, or both of smooth glass, each followed further.
GuideMarch::Seen GuideMarch::bounce(const Shaded& at, const SurfaceHit& hit, const GuideMedia& media, MediaLine& line,
                                    const Way& way) const {
  Seen seen;
  const Bsdf& bsdf = at.bsdf;
  const dvec3 wo = at.to_frame(at.wo);
  const dvec3 outside = at.inside ? -hit.normal : hit.normal;
  const bool rough = !bsdf.delta(), glass = bsdf.kind == Bsdf::Kind::kDielectric;
  const int rays = rough && way.bounces == 0 && way.faces == 0 ? kLobeRays : 1;
  const auto follow = [&](const Bsdf::Sample& sample, double share) {
    const dvec3 d = glm::normalize(at.frame.to_world(sample.wi));
    if (glm::dot(d, outside) * sample.wi.z < 0) return;
    const dvec3 weight = share * sample.weight;
    Way on = way;
    on.weight *= max_component(weight);
    on.spread += rough ? 2 * bsdf.alpha() / std::sqrt(rays) : 0;
    (sample.transmitted || at.inside ? on.faces : on.bounces)++;
    if (!way.only_lights)
      on.shown = rough ? Way::Shown::kUngrouped : way.shown == Way::Shown::kNone ? Way::Shown::kNone : Way::Shown::kAll;
    if (on.bounces > kMostBounces || on.faces > kMostFaces) {
      if (!way.only_lights) seen.straight += weight * context_.lights->environment()->radiance(d);
      return;
    }
    seen.add(weight, look({Surfaces::leave(hit, at.on, d), d}, media, line, on));
  };
  for (int i = 0; i < rays; ++i) {
    dvec3 u(0);
    if (rays > 1) u = {(i + 0.5) / rays, i * kGoldenRatio - std::floor(i * kGoldenRatio), 0};
    Bsdf::Sample sample;
    if (!glass) {
      if (bsdf.sample(wo, at.inside, u, sample)) follow(sample, 1.0 / rays);
      continue;
    }
    // Both branches, weighted by the reflectance of the facet.
    const bool reflects = bsdf.sample(wo, at.inside, u, sample);
    const dvec3 facet = glm::normalize(wo + (reflects ? sample.wi : wo));
    double reflected = fresnel_dielectric(glm::dot(wo, facet), at.inside ? 1 / bsdf.ior : bsdf.ior);
    if (way.weight * reflected / rays < kLeastWeight && at.inside) reflected = 0;
    if (way.weight * (1 - reflected) / rays < kLeastWeight && reflected > 0.5) reflected = 1;
    if (reflects && reflected > 0) follow(sample, reflected / rays);
    u.z = 1 - 1e-12;
    if (reflected < 1 && bsdf.sample(wo, at.inside, u, sample) && sample.transmitted)
      follow(sample, (1 - reflected) / rays);
  }
  return seen;
}

GuideMarch::Seen GuideMarch::mirrored(const Eye& eye, const Shaded& at, const SurfaceHit& hit, const GuideMedia& media,
                                      MediaLine& line) const {
  const bool smooth = at.bsdf.delta();
  Way way;
  way.shown = smooth ? Way::Shown::kNone : Way::Shown::kUngrouped;
  Seen seen = bounce(at, hit, media, line, way);
  if (!smooth || (context_.lights->suns().empty() && context_.lights->finite().empty())) return seen;
  // Small lights, by rays that meet surfaces alone.
  way.shown = Way::Shown::kAll;
  way.only_lights = true;
  const double share = 1.0 / (kLightsAcross * kLightsAcross);
  for (int i = 0; i < kLightsAcross * kLightsAcross; ++i) {
    const dvec2 off = (dvec2(i % kLightsAcross, i / kLightsAcross) + 0.5) / static_cast<double>(kLightsAcross) - 0.5;
    const Ray ray = camera_.ray(eye.film + eye.cell * off, eye.lens, eye.time);
    const std::optional<SurfaceHit> own = context_.surfaces->intersect(ray, kFar);
    if (own && own->surface == hit.surface) seen.add(dvec3(share), bounce(shaded(ray, *own), *own, media, line, way));
  }
  return seen;
}

}  // namespace brume
