#include "render/session/explain.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/text.h"
#include "render/film/film.h"
#include "render/guides/guides.h"
#include "render/world/surfaces.h"
#include "volume/tracking.h"

namespace brume {
namespace {

double megabytes(double bytes) {
  return bytes / 1e6;
}

std::string phase_text(const PhaseFunction& p) {
  if (p.isotropic()) return "isotropic";
  if (p.is_henyey_greenstein()) return fmt::format("Henyey-Greenstein, g = {}", p.first.g);
  if (p.second.alpha == 0)
    return fmt::format("two Henyey-Greenstein lobes, g = {} and {} ({:.3g})", p.first.g, p.second.g, p.second_weight);
  return fmt::format("Henyey-Greenstein, g = {:.4g}, and Draine, g = {:.4g} and alpha = {:.4g} ({:.3g})", p.first.g,
                     p.second.g, p.second.alpha, p.second_weight);
}

std::string depth_text(const Medium& m) {
  const std::array<double, 3> tau = depths_along_axes(m.thickest());
  std::string text =
      fmt::format("optical depth {:.3g}, {:.3g}, {:.3g} through the middle along its axes", tau[0], tau[1], tau[2]);
  if (m.instances()) text += fmt::format(" of the thickest of {} instances", m.instances()->size());
  return text;
}

std::string medium_text(const Medium& m) {
  std::string text;
  if (m.homogeneous()) {
    text = m.falls_off()                                             ? "layer that falls off with height"
           : m.homogeneous()->shape == HomogeneousShape::Shape::kBox ? "homogeneous box"
                                                                     : "homogeneous sphere";
  } else {
    const BrickGrid& b = m.bricks();
    text = fmt::format("{} bricks of {}^3, {} x {} x {} cells, maximum density {:.4g}", b.brick_count(), b.stored(),
                       b.cells().x, b.cells().y, b.cells().z, b.maximum());
  }
  text += m.chromatic() ? ", chromatic" : ", grey";
  if (m.coloured()) text += ", albedo from a colour grid";
  if (m.displacement()) text += ", blurred by its velocity";
  if (const Detail* const d = m.detail())
    text += fmt::format(", detail of {} octaves down to {:.3g} voxels{}", d->octaves(), 1 / d->finest(),
                        d->velocity() ? ", carried by its velocity" : "");
  return text + "; " + phase_text(m.phase()) + "; " + depth_text(m);
}

}  // namespace

std::string explain(const Plan& plan, const Scene& scene, const SceneMedia& media, const Lights& lights,
                    const Surfaces* surfaces, const Guides* guides) {
  std::string text = "plan\n";
  const auto line = [&](std::string_view what, std::string_view how) {
    text += fmt::format("  {:<16}{}\n", what, how);
  };
  if (!plan.has_media()) line("media", "none: nothing scatters in space");
  for (const Medium& m : media.media()) line("medium", medium_text(m));
  for (const SceneMedia::Part& part : media.parts())
    line("  memory", fmt::format("{}: {:.1f} MB", part.name, megabytes(static_cast<double>(part.bytes))));
  if (plan.has_media()) {
    line("flight",
         plan.chromatic ? "delta tracking by a hero channel; spectral multiple importance sampling over the channels"
         : plan.media.size() == 1 ? "delta tracking through the majorant grid"
                                  : "delta tracking in each medium, the first collision of all is the path's");
    const auto in_double = std::count(plan.media.begin(), plan.media.end(), Precision::kDouble);
    if (in_double) line("  in double", fmt::format("{} of {} media, one path at a time", in_double, plan.media.size()));
    line("first collision",
         plan.first_collision.forced ? "forced: camera rays scatter what does not pass" : "by chance");
    if (plan.first_collision.paths.most() > 1)
      line("  of each ray", fmt::format("{:.1f} paths go on in the mean, up to {} where light is noisy",
                                        plan.first_collision.paths.mean(), plan.first_collision.paths.most()));
    line("motion", plan.moving_media ? "media are placed anew for each path's time" : "none");
  }
  line("emission", !plan.emission ? "none"
                   : plan.seen_emission
                       ? "along camera rays one look-up per voxel, dimmed exactly; then one per four along each flight"
                       : "stratified along each flight, one look-up per voxel (per four after a scattering)");
  line("light sampling", plan.light_sampling
                             ? "next-event estimation, ratio tracking, balance heuristic against direction sampling"
                             : "none: direction sampling only");
  if (lights.choice().count() > 1) line("  choice", "one light by its estimated irradiance at the vertex");
  if (lights.choice().count() > lights.choice(false).count())
    line("  fire", fmt::format("its points, from surfaces and {} of {} media; elsewhere directions find it",
                               std::count(plan.far_from_fire.begin(), plan.far_from_fire.end(), true),
                               plan.far_from_fire.size()));
  if (!plan.near_lights.empty()) line("  near lights", "sampled along flights too, equiangularly");
  if (!plan.lit_balls.empty())
    line("  lit smoke", fmt::format("vertices aim at the smoke around {} lamps, too", plan.lit_balls.size()));
  if (scene.render.indirect_limit > 0)
    line("indirect limit",
         fmt::format("paths bring a mean radiance of {} at most: biased", scene.render.indirect_limit));
  line("environment",
       lights.environment()->black() ? "black"
       : lights.environment()->constant()
           ? "constant"
           : fmt::format("lat-long picture, {:.1f} MB", megabytes(static_cast<double>(lights.environment()->bytes()))));
  line("lights", fmt::format("{} sun, {} sphere or rectangle, {} point or spot, {} mesh", lights.suns().size(),
                             lights.finite().size(), lights.points().size(), lights.mesh_count()));
  line("surfaces", surfaces ? fmt::format("{} meshes through Embree, about {:.1f} MB{}", surfaces->count(),
                                          megabytes(static_cast<double>(surfaces->bytes())),
                                          surfaces->any_straight() ? "; straight shadows of dielectrics: biased" : "")
                            : "none: Embree is not touched");
  line("camera", std::string(plan.lens ? "thin lens" : "pinhole") + (plan.shutter ? ", motion over the shutter" : ""));
  line("isosurface", plan.isosurface ? "looked for once per path, for gradient and coverage" : "not looked for");
  if (plan.marched()) line("marched layers", "once per path, one look-up per voxel length");
  if (guides) {
    line("guides", guides->explain());
    for (const std::string& missing : guides->left_out()) line("  leave out", missing);
  }
  line("layers", "beauty, alpha, sample_count, invalid_count" + std::string(plan.layers.text().empty() ? "" : ", ") +
                     join(plan.layers.text()) +
                     (plan.layers.statistics ? "; each with mean_variance, half_a, half_b" : "") +
                     (plan.layers.buckets ? ", bucket_0 .. bucket_7" : ""));
  const int w = scene.film.width, h = scene.film.height;
  line("film",
       fmt::format("{} x {}: layers {:.1f} MB; sums {:.1f} MB while all tiles are kept", w, h,
                   megabytes(Film::layer_bytes(w, h, plan.layers)), megabytes(Film::state_bytes(w, h, plan.layers))));
  return text;
}

}  // namespace brume
