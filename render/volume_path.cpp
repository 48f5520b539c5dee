#include <algorithm>

#include "render/integrator.h"
#include "volume/gradient.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();
// Pairs of Sobol dimensions: 0 is the film, then two per event (phase, light) for the first events.
constexpr uint64_t kSobolEvents = 6;

double balance(double a, double b) {
  return a / (a + b);
}

void record_surface(const PathContext& context, const Ray& ray, PathSample& sample) {
  const Medium& medium = *context.medium;
  const Ray local = medium.to_local(ray);
  const std::optional<double> t = find_surface(medium, local, context.surface_density);
  if (!t) return;
  sample.coverage = 1.0;
  if (!context.plan.layers.gradient) return;
  // Half a voxel inside, where the differences see the medium on both sides.
  const double inside = *t + 0.5 / glm::length(local.d);
  if (const auto gradient = density_gradient(medium, local.at(inside))) sample.gradient = glm::normalize(*gradient);
}

/// Radiance of infinitely far lights along a ray that left the scene, each weighted against light sampling.
template <bool kLightSampling>
dvec3 escaped_radiance(const PathContext& context, const dvec3& d, double pdf_phase, bool from_camera) {
  const Lights& lights = *context.lights;
  const auto weight = [&](double pdf_light) {
    return !kLightSampling || from_camera ? 1.0 : balance(pdf_phase, pdf_light);
  };
  dvec3 sum(0);
  if (!lights.environment.black() && (!from_camera || lights.environment.visible())) {
    const double share = lights.choice_of_environment();
    sum +=
        lights.environment.radiance(d) * weight(kLightSampling && share > 0 ? share * lights.environment.pdf(d) : 0.0);
  }
  for (size_t i = 0; i < lights.suns.size(); ++i)
    if (lights.suns[i].contains(d) && (!from_camera || lights.suns[i].visible()))
      sum += lights.suns[i].radiance() * weight(lights.choice_of_sun(i) * lights.suns[i].pdf());
  return sum;
}

/// Next-event estimation from a vertex: one light, one shadow ray.
template <bool kFiniteLights>
dvec3 sampled_light(const PathContext& context, const dvec3& p, const dvec3& d, double choice, const dvec2& u, Rng& rng,
                    PathCounters& counters) {
  const Lights& lights = *context.lights;
  const Medium& medium = *context.medium;
  const LightSample light = lights.sample(p, choice, u);
  if (!(light.pdf > 0)) return dvec3(0);
  const double phase = medium.phase().value(glm::dot(d, light.wi));
  const dvec3 unoccluded = light.radiance * (phase / light.pdf * (light.delta ? 1.0 : balance(light.pdf, phase)));
  if (unoccluded == dvec3(0)) return dvec3(0);
  const Ray shadow{p, light.wi};
  if constexpr (kFiniteLights)
    for (const SphereLight& sphere : lights.spheres) {
      // Rays end on every sphere; the light's own surface is not in its way.
      const double t = sphere.intersect(shadow);
      if (t > 0 && t < light.distance * (1.0 - 1e-9)) return dvec3(0);
    }
  return unoccluded * estimate_transmittance(medium, medium.to_local(shadow), light.distance, rng, counters.tracking);
}

template <bool kMedium, bool kLightSampling, bool kFiniteLights>
PathSample trace_path(const PathContext& context, const Ray& camera_ray, const Sobol& sobol, Rng& rng,
                      PathCounters& counters) {
  PathSample sample;
  ++counters.paths;
  if (kMedium && context.plan.surface) record_surface(context, camera_ray, sample);

  Ray ray = camera_ray;
  dvec3 throughput(1);
  double pdf_phase = 1;
  uint64_t events = 0;  // real scatterings so far; null collisions are none
  for (;; ++events) {
    // Light that is met after fewer than two scatterings is direct (TRANSPORT.md section 11).
    const auto deposit = [&](const dvec3& radiance, uint64_t e) {
      (e < 2 ? sample.direct : sample.indirect) += throughput * radiance;
    };

    double t_max = kFar;
    const SphereLight* hit = nullptr;
    size_t hit_index = 0;
    if constexpr (kFiniteLights)
      for (size_t i = 0; i < context.lights->spheres.size(); ++i) {
        const SphereLight& sphere = context.lights->spheres[i];
        if (events == 0 && !sphere.visible()) continue;
        const double t = sphere.intersect(ray);
        if (t > 0 && t < t_max) t_max = t, hit = &sphere, hit_index = i;
      }

    double t = -1;
    if constexpr (kMedium)
      t = sample_collision(*context.medium, context.medium->to_local(ray), t_max, rng, counters.tracking);
    if (t < 0) {
      if (events == 0) sample.transmittance = 1;
      if (hit) {
        const double pdf_light = context.lights->choice_of_sphere(hit_index) * hit->pdf(ray.o);
        deposit(hit->radiance() * (events == 0 || !kLightSampling ? 1.0 : balance(pdf_phase, pdf_light)), events);
      } else {
        deposit(escaped_radiance<kLightSampling>(context, ray.d, pdf_phase, events == 0), events);
      }
      break;
    }

    if constexpr (kMedium) {
      const Medium& medium = *context.medium;
      ray.o = ray.at(t);
      throughput *= medium.albedo();  // absorption by weight, not by chance
      const auto pair = [&](uint32_t i) {
        return events < kSobolEvents ? sobol.pair(static_cast<uint32_t>(1 + 2 * events) + i)
                                     : dvec2{rng.uniform(), rng.uniform()};
      };
      if constexpr (kLightSampling) {
        const double choice = rng.uniform();
        deposit(sampled_light<kFiniteLights>(context, ray.o, ray.d, choice, pair(1), rng, counters), events + 1);
      }
      if (events + 1 >= static_cast<uint64_t>(context.roulette_start)) {
        const double survival = std::clamp(max_component(throughput), 0.05, 1.0);
        if (survival < 1) {
          if (!(rng.uniform() < survival)) break;
          throughput /= survival;
        }
      }
      if (events + 1 >= static_cast<uint64_t>(context.max_events)) {
        ++counters.capped_paths;
        counters.capped_throughput += max_component(throughput);
        break;
      }
      const dvec3 d = medium.phase().sample(ray.d, pair(0));
      pdf_phase = medium.phase().value(glm::dot(ray.d, d));
      ray.d = d;
    }
  }
  counters.longest = std::max(counters.longest, events);
  return sample;
}

}  // namespace

void PathCounters::merge(const PathCounters& other) {
  tracking.merge(other.tracking);
  paths += other.paths;
  capped_paths += other.capped_paths;
  capped_throughput += other.capped_throughput;
  longest = std::max(longest, other.longest);
}

TracePath select_path_tracer(const Plan& plan) {
  if (!plan.medium) return plan.finite_lights ? trace_path<false, false, true> : trace_path<false, false, false>;
  if (!plan.light_sampling) return plan.finite_lights ? trace_path<true, false, true> : trace_path<true, false, false>;
  return plan.finite_lights ? trace_path<true, true, true> : trace_path<true, true, false>;
}

}  // namespace brume
