#include "render/transport/surface_events.h"

#include <algorithm>
#include <utility>

#include "render/transport/estimator.h"
#include "render/transport/group_lights.h"

namespace brume {

/// A point of a surface, and how it scatters.
struct SurfaceEvents::Vertex {
  Vertex(const Surfaces& surfaces, const Ray& ray, const SurfaceHit& met, const Lights* aims)
      : hit(met),
        settings(surfaces.settings(met.surface)),
        bsdf(surfaces.bsdf(met)),
        p(ray.at(met.t)),
        wo(-ray.d),
        front(glm::dot(wo, met.normal) > 0),
        outside(front ? met.normal : -met.normal),
        frame(shading_normal()),
        wo_local(to_local(wo)) {
    if (aims && bsdf.kind == Bsdf::Kind::kDiffuse)
      cones = aims->field_cones(p, bsdf.passed == dvec3(0) ? outside : dvec3(0));
  }

  /// Light takes the shading normal's angles but the geometry's side: what would leak through is left out.
  dvec3 shading_normal() const {
    const dvec3 smooth = front ? hit.shading : -hit.shading;
    return glm::dot(wo, smooth) > 1e-4 ? smooth : outside;
  }
  dvec3 to_local(const dvec3& w) const { return {glm::dot(w, frame.x), glm::dot(w, frame.y), glm::dot(w, frame.z)}; }
  bool leaks(const dvec3& wi, double local_z) const { return glm::dot(wi, outside) * local_z < 0; }
  /// BSDF times cosine of a direction, and the density of drawing it in scatter().
  std::pair<dvec3, double> scattering(const dvec3& wi) const {
    const dvec3 wi_local = to_local(wi);
    if (leaks(wi, wi_local.z)) return {dvec3(0), 0.0};
    return {bsdf.value(wo_local, wi_local, !front), cones.mixed(bsdf.pdf(wo_local, wi_local, !front), wi)};
  }

  const SurfaceHit& hit;
  const SurfaceSettings& settings;
  Bsdf bsdf;
  dvec3 p, wo;
  bool front;
  dvec3 outside;
  Frame frame;
  dvec3 wo_local;
  FieldCones cones;
};

bool SurfaceEvents::meet(size_t i, const dvec3& eye, SlotList& shadows, BallSamples* balls, GroupLights* groups) {
  WorldPaths::Past& past = w_.past[i];
  past.to_catcher = false;
  const bool first = p_.events[i] == 0;
  const Vertex v(*c_.surfaces, w_.ray[i], w_.hit[i], aims());
  if (first && v.settings.role == "holdout") {
    past.in_hole = true;
    return false;
  }
  if (first && v.settings.role == "shadow_catcher") return pass_catcher(i, v, shadows);
  if (const dvec3 emitted = c_.surfaces->emitted(v.hit, v.front); emitted != dvec3(0)) emit(i, v, emitted);
  if (first) past.first_on_surface = true;
  if (first && c_.plan.first_surface) {
    PathSample& sample = samples_[i];
    sample.albedo = sample.surface_albedo = v.bsdf.albedo + v.bsdf.passed;
    sample.surface_share = 1;
    sample.normal = v.frame.z;
    sample.depth = glm::distance(eye, v.p);
    sample.position = v.p + c_.world_shift;
  }
  ++p_.events[i];
  if (c_.plan.light_sampling && !v.bsdf.delta()) {
    sample_light(i, v, v.p, false, shadows);
    if (groups)
      groups->aim_from_surface(i, v.p, [&](const LightSample& light) { return aim_at(i, v, v.p, light, false); });
  }
  if (balls && !v.bsdf.delta())
    balls->draw(i, v.p, p_.events[i], [&](const dvec3& wi) {
      const auto [value, pdf] = v.scattering(wi);
      return BallSamples::Scattering{throughput(i) * value, pdf, Surfaces::leave(v.hit, v.p, wi)};
    });
  return scatter(i, v);
}

/// Unseen itself: the same path goes on behind it. What it gathers is for its layers.
bool SurfaceEvents::pass_catcher(size_t i, const Vertex& v, SlotList& shadows) {
  if (c_.plan.light_sampling && c_.plan.first_surface) {
    w_.past[i].to_catcher = true;
    sample_light(i, v, Surfaces::leave(v.hit, v.p, v.wo), true, shadows);
  }
  w_.ray[i].o = Surfaces::leave(v.hit, v.p, w_.ray[i].d);
  w_.past[i].passed = 0;
  return true;
}

/// Light of the surface itself, against light sampling at the vertex before.
void SurfaceEvents::emit(size_t i, const Vertex& v, const dvec3& radiance) {
  const WorldPaths::Past& past = w_.past[i];
  const MeshLight& light = c_.lights->mesh(c_.surfaces->light_of(v.hit.surface));
  double pdf_light = 0;
  if (c_.plan.light_sampling) {
    pdf_light = c_.lights->choice(past.samples_fields).probability(light, w_.from_vertex(i).o) *
                light.pdf(past.passed + v.hit.t, glm::dot(v.wo, v.hit.normal));
  }
  if (past.straight && pdf_light > 0) return;
  const bool one_technique = p_.events[i] == 0 || past.specular;
  const double weight = one_technique ? 1.0 : balance(static_cast<double>(p_.pdf[i]), pdf_light);
  const dvec3 L = throughput(i) * radiance * weight;
  if (p_.events[i] > 0) return deposit(p_, w_, i, vec3(L), p_.events[i], light.group);
  w_.surface[i] += vec3(L);
  w_.add_to_group(i, light.group, vec3(L), /*direct=*/true);
  if (c_.plan.first_surface) samples_[i].surface_emission += L;
}

/// @param from  where the shadow ray begins; the vertex itself is left to the light's side
void SurfaceEvents::sample_light(size_t i, const Vertex& v, const dvec3& from, bool only_technique, SlotList& shadows) {
  PathGenerator rng(p_, i);
  const double choice = rng.uniform();
  const dvec2 u = rng.pair();
  const LightSample light = c_.lights->choice().sample(from, choice, u);
  w_.note_light(i, light, u, p_.events[i] == 1);
  const std::optional<AimedLight> aimed = aim_at(i, v, from, light, only_technique);
  if (!aimed) return;
  take(i, *aimed);
  shadows.push(i);
}

void SurfaceEvents::take(size_t i, const AimedLight& light) {
  w_.shadow[i] = light.shadow;
  w_.shadow_end[i] = light.end;
  p_.mis[i] = light.mis;
  p_.contribution.set(i, light.L);
  p_.transmittance[i] = 1;
}

/// The shadow ray towards a light sample, and what it brings; nothing where that is not worth to be traced.
std::optional<AimedLight> SurfaceEvents::aim_at(size_t i, const Vertex& v, const dvec3& from, const LightSample& light,
                                                bool only_technique) {
  if (!(light.pdf > 0)) return {};
  const auto [value, pdf] = v.scattering(light.wi);
  const double weight = light.delta || only_technique ? 1.0 : balance(light.pdf, pdf);
  const dvec3 L = throughput(i) * light.radiance * value * (weight / light.pdf);
  if (only_technique) samples_[i].catcher_unshadowed += L;
  if (L == dvec3(0)) return {};
  // Lights on either side of the surface are reached from that side.
  const Ray shadow{only_technique ? from : Surfaces::leave(v.hit, v.p, light.wi), light.wi};
  if (c_.lights->blocked(shadow, light.distance, light.light)) return {};
  return AimedLight{shadow, light.distance, vec3(L), static_cast<float>(weight)};
}

bool SurfaceEvents::scatter(size_t i, const Vertex& v) {
  PathGenerator rng(p_, i);
  dvec3 weight = throughput(i);
  if (p_.events[i] >= static_cast<uint32_t>(c_.roulette_start)) {
    const double chance = survival(max_component(weight));
    if (chance < 1) {
      if (!(rng.uniform() < chance)) return false;
      weight /= chance;
    }
  }
  if (p_.events[i] >= static_cast<uint32_t>(c_.max_events)) {
    ++counters_.capped_paths;
    counters_.capped_throughput += max_component(weight);
    return false;
  }
  Bsdf::Sample out;
  dvec3 d;
  const bool aims = v.cones.share() > 0, aimed = aims && rng.uniform() < v.cones.share();
  const dvec2 u = rng.pair();
  if (aimed) {
    d = v.cones.sample(rng.uniform(), u);
    out.wi = v.to_local(d);
  } else {
    if (!v.bsdf.sample(v.wo_local, !v.front, {u.x, u.y, rng.uniform()}, out)) return false;
    d = glm::normalize(v.frame.to_world(out.wi));
  }
  if (aims) {
    const auto [value, pdf] = v.scattering(d);
    if (!(pdf > 0)) return false;
    out.weight = value / pdf;
    out.pdf = pdf;
  }
  weight *= out.weight;
  if (weight == dvec3(0) || v.leaks(d, out.wi.z)) return false;
  p_.throughput.set(i, vec3(weight));
  WorldPaths::Past& past = w_.past[i];
  past.specular = v.bsdf.delta();
  // Light sampling sees past straight transmissions alone.
  past.straight = past.sampled_light && v.settings.shadow == "straight" && out.wi.z * v.wo_local.z < 0;
  past.sampled_light = !past.specular || past.straight;
  past.samples_fields = !past.straight || past.samples_fields;
  past.on_surface = true;
  past.passed = 0;
  p_.pdf[i] = static_cast<float>(out.pdf);
  w_.ray[i] = {Surfaces::leave(v.hit, v.p, d), d};
  p_.d.set(i, vec3(d));
  return true;
}

void SurfaceEvents::shadow(SlotList& shadows) {
  shadows.keep_if([&](size_t i) {
    const Surfaces::Passage passage = c_.surfaces->passage(w_.shadow[i], w_.shadow_end[i] * (1.0 - 1e-4), w_.time[i]);
    if (passage.light == dvec3(0)) return false;
    // Behind straight shadows no other technique finds the light.
    const dvec3 left = passage.straight ? passage.light / static_cast<double>(p_.mis[i]) : passage.light;
    if (passage.straight) p_.mis[i] = 1;
    p_.contribution.set(i, p_.contribution[i] * vec3(left));
    return true;
  });
}

}  // namespace brume
