#include "render/plan.h"

#include <fmt/format.h>

#include "base/error.h"
#include "base/text.h"
#include "volume/tracking.h"

namespace brume {

LayerRequest LayerRequest::of(const std::vector<std::string>& names, bool statistics) {
  LayerRequest request{false, false, false, false, false, statistics};
  const std::vector<std::string> known = {"direct", "indirect", "gradient", "coverage", "transmittance"};
  bool* const flags[] = {&request.direct, &request.indirect, &request.gradient, &request.coverage,
                         &request.transmittance};
  for (const std::string& name : names) {
    const auto it = std::find(known.begin(), known.end(), name);
    if (it == known.end()) throw InputError(fmt::format("no layer '{}' to record{}", name, suggestion(name, known)));
    *flags[it - known.begin()] = true;
  }
  return request;
}

Plan make_plan(const Lights& lights, const Medium* medium, const LayerRequest& layers) {
  Plan plan;
  plan.medium = medium && !medium->bricks().empty() && medium->extinction_per_density() > 0;
  plan.light_sampling = plan.medium && lights.any_sampled();
  plan.finite_lights = !lights.spheres.empty();
  plan.surface = plan.medium && (layers.gradient || layers.coverage);
  plan.layers = layers;
  return plan;
}

double Plan::film_bytes(int width, int height) const {
  // Beauty and alpha, the layers asked for, each with three statistics or none, and two counts.
  const double channels =
      4.0 + 3 * (layers.direct + layers.indirect + layers.gradient + layers.transmittance) + layers.coverage;
  return (channels * (layers.statistics ? 4 : 1) + 2) * sizeof(float) * width * height;
}

std::string Plan::explain(const Scene& scene, const Lights& lights, const Medium* m) const {
  std::string text;
  const auto line = [&](std::string_view what, std::string_view how) {
    text += fmt::format("  {:<16}{}\n", what, how);
  };
  const auto yes = [&](bool b, std::string_view on, std::string_view off) { return std::string(b ? on : off); };
  text += "plan\n";
  if (m) {
    const BrickGrid& b = m->bricks();
    line("medium", medium ? fmt::format("{} bricks of 9^3, {} x {} x {} cells, {:.1f} MB; maximum density {:.4g}",
                                        b.brick_count(), b.cells().x, b.cells().y, b.cells().z,
                                        static_cast<double>(b.bytes()) / 1e6, b.maximum())
                          : "absent (no density): T = 1");
  } else {
    line("medium", "none");
  }
  if (medium) {
    line("flight", "delta tracking through the majorant grid (unbiased)");
    // A sanity check on units: what a ray through the middle meets, along each axis of the grid.
    const dvec3 middle = 0.5 * (m->bricks().support_lo() + m->bricks().support_hi());
    double tau[3];
    for (int a = 0; a < 3; ++a) {
      dvec3 start = middle, end = middle;
      start[a] = m->bricks().support_lo()[a], end[a] = m->bricks().support_hi()[a];
      const double length = glm::distance(m->to_world(start), m->to_world(end));
      tau[a] = optical_depth(*m, Ray{start, (end - start) / length}, length);
    }
    line("optical depth",
         fmt::format("{:.3g}, {:.3g}, {:.3g} through the middle along the grid's axes", tau[0], tau[1], tau[2]));
    line("phase", m->phase().g == 0 ? "isotropic" : fmt::format("Henyey-Greenstein, g = {}", m->phase().g));
  }
  line("light sampling",
       yes(light_sampling, "next-event estimation, ratio tracking, balance heuristic against phase sampling",
           "none: phase sampling only"));
  line("environment",
       lights.environment.black() ? "black"
       : lights.environment.constant()
           ? "constant"
           : fmt::format("lat-long picture, {:.1f} MB", static_cast<double>(lights.environment.bytes()) / 1e6));
  line("lights", fmt::format("{} sun, {} sphere", lights.suns.size(), lights.spheres.size()));
  line("surfaces", "none: Embree is not touched");
  line("emission", "none");
  line("medium surface", yes(surface, "looked for once per path, for gradient and coverage", "not looked for"));
  std::vector<std::string> recorded = {"beauty", "alpha", "sample_count", "invalid_count"};
  for (const auto& [on, name] : {std::pair(layers.direct, "direct"),
                                 {layers.indirect, "indirect"},
                                 {layers.gradient, "gradient"},
                                 {layers.coverage, "coverage"},
                                 {layers.transmittance, "transmittance"}})
    if (on) recorded.push_back(name);
  line("layers", join(recorded) + (layers.statistics ? ", each with mean_variance, half_a, half_b" : ""));
  line("film", fmt::format("{} x {}, {:.1f} MB", scene.film.width, scene.film.height,
                           film_bytes(scene.film.width, scene.film.height) / 1e6));
  return text;
}

}  // namespace brume
