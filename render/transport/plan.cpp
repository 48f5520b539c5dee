#include "render/transport/plan.h"

#include <algorithm>

#include "image/light_layers.h"
#include "render/transport/emission.h"
#include "render/transport/integrator.h"
#include "render/transport/lane_detail.h"
#include "render/world/camera.h"
#include "render/world/surfaces.h"
#include "volume/lane_grid.h"

namespace brume {
Precision precision_for(const Medium& m) {
  if (m.homogeneous()) return Precision::kClosedForm;
  if (m.global_majorant()) return Precision::kDouble;
  if (const Displacement* const d = m.displacement()) {
    for (const BrickGrid& part : d->field.parts)
      if (!part.empty() && !LaneGrid::fits(part)) return Precision::kDouble;
    if (!LaneGrid::fits(d->envelope)) return Precision::kDouble;
  }
  if (m.detail() && !velocity_fits(*m.detail())) return Precision::kDouble;
  const Medium most = m.thickest();
  const double longest_voxel =
      most.voxel_volume() / (most.voxel_size() * most.voxel_size());  // at least its longest edge
  const double free_path = 1 / (most.extinction_per_density() * most.maximum_density() * longest_voxel);
  return LaneGrid::fits(m.bricks()) && LaneGrid::resolves(m.bricks(), free_path) ? Precision::kLanes
                                                                                 : Precision::kDouble;
}

namespace {

constexpr double kSeldomFound = 0.2;

/// Whether most of a medium is so far from a field that emits that directions drawn by the phase function seldom find
/// it.
bool far_from_fields(const Medium& medium, const SceneMedia& media, const Lights& lights) {
  const auto [centre, radius] = medium.bounding_sphere();
  for (size_t f = 0; f < media.emissions().size(); ++f) {
    const FieldLight* const light = lights.field(f);
    if (light && light->seldom_found(centre, radius * radius / 3) > kSeldomFound) return true;
  }
  return false;
}

/// Whether all there is lies in one still grid, but for still fields that emit.
bool is_one_grid(const Plan& plan, const SceneMedia& media, const Lights& lights) {
  const auto& fields = media.emissions();
  return plan.media.size() == 1 && plan.media[0] == Precision::kLanes && !plan.instances && !plan.holdouts &&
         !plan.chromatic && !plan.surfaces && !plan.moving_media && !plan.layers.records && lights.all_solid() &&
         std::all_of(fields.begin(), fields.end(), LaneEmission::fits);
}

}  // namespace

Plan make_plan(const Scene& scene, const SceneMedia& media, const Lights& lights, const Surfaces* surfaces,
               const Camera& camera, const LayerRequest& layers) {
  Plan plan;
  const auto& all = media.media();
  for (const Medium& m : all) {
    plan.media.push_back(precision_for(m));
    plan.far_from_fire.push_back(far_from_fields(m, media, lights));
  }
  plan.instances = std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.instances() != nullptr; });
  plan.holdouts = std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.holdout(); });
  plan.chromatic = std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.chromatic(); });
  plan.moving_media = std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.moves(); });
  plan.surfaces = surfaces != nullptr;
  plan.light_sampling = (plan.has_media() || plan.surfaces) && lights.any_sampled();
  plan.finite_lights = !lights.finite().empty();
  plan.emission = !media.emissions().empty();
  plan.lens = camera.has_lens();
  const auto& fields = media.emissions();
  plan.shutter = camera.moves() || plan.moving_media || (surfaces && surfaces->any_moves()) ||
                 std::any_of(fields.begin(), fields.end(), [](const EmissionField& e) { return e.moves(); });
  if (plan.has_media()) {
    plan.isosurface = layers.has(layer::gradient) || layers.has(layer::coverage) || layers.records;
    plan.flash = layers.has(layer::flash);
    for (const LayerName& l : {layer::scatter_depth, layer::scatter_position, layer::scatter_density,
                               layer::scatter_share, layer::albedo, layer::gradient_first_scatter, layer::flash})
      plan.first_event = plan.first_event || layers.has(l) || layers.records;
    plan.first_scatter_gradient = layers.has(layer::gradient_first_scatter) || plan.flash || layers.records;
    plan.weighted_gradient = layers.has(layer::gradient_transmittance_weighted);
    plan.optical_depth = layers.has(layer::optical_depth);
  }
  if (plan.surfaces)
    for (const LayerName& l : {layer::albedo, layer::surface_emission, layer::surface_albedo, layer::surface_share,
                               layer::normal, layer::depth, layer::position, layer::catcher, layer::catcher_unshadowed})
      plan.first_surface = plan.first_surface || layers.has(l) || layers.records;
  plan.layers = layers;
  plan.layers.light_groups = lights.groups();
  if (lights.groups().empty()) std::erase(plan.layers.names, kLightAimed);
  plan.layers.light_parts = layers.light_parts && !lights.groups().empty();
  // Light sampled along a flight does not know which medium scatters it there, so none may be a holdout.
  if (!plan.holdouts) plan.near_lights = choose_near_lights(all, lights, scene.render.near_lights);
  plan.interpolate = scene.render.lookup == "interpolated";
  plan.one_grid = is_one_grid(plan, media, lights);
  // In the one grid paths know no world, and forced first collisions gain more. Records have no place for such light.
  if (!plan.one_grid && !plan.holdouts && !plan.moving_media && !layers.records)
    plan.lit_balls = choose_lit_balls(all, lights, plan.near_lights, scene.render.near_lights);
  // Points of lit balls are weighed against directions of phase functions and BSDFs alone.
  plan.aims_at_fire =
      plan.light_sampling && lights.any_scattered_field() && plan.lit_balls.empty() && !plan.layers.records;
  plan.seen_emission =
      plan.emission && plan.has_media() && !plan.moving_media && !plan.instances &&
      std::find(plan.media.begin(), plan.media.end(), Precision::kDouble) == plan.media.end() &&
      std::none_of(all.begin(), all.end(), [](const Medium& m) { return m.falls_off() || m.detail(); }) &&
      std::all_of(fields.begin(), fields.end(), LaneEmission::fits);
  std::vector<Ray> rays;
  if (plan.one_grid || plan.seen_emission)
    for (const PathRequest& r : coarse_requests(scene, plan, camera, 24, 1)) rays.push_back(r.ray);
  if (plan.one_grid && (!plan.emission || plan.seen_emission))  // else emission is integrated along free flights
    plan.first_collision = choose_first_collision(all[0], rays, scene.render.first_collision);
  if (plan.seen_emission && !plan.layers.records)
    plan.first_collision.paths = choose_paths(all, fields, rays, plan.first_collision.forced);
  return plan;
}

}  // namespace brume
