#include "render/transport/plan.h"

#include <algorithm>

#include "base/running_statistics.h"
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
  const Medium most = m.thickest();
  const double longest_voxel =
      most.voxel_volume() / (most.voxel_size() * most.voxel_size());  // at least its longest edge
  const double free_path = 1 / (most.extinction_per_density() * most.maximum_density() * longest_voxel);
  return LaneGrid::fits(m.bricks()) && LaneGrid::resolves(m.bricks(), free_path) ? Precision::kLanes
                                                                                 : Precision::kDouble;
}

namespace {

// Where a smaller share of directions would aim at fire, none do: they would not pay for themselves.
constexpr double kLeastAimed = 0.05;

// How seldom directions drawn by the phase function find a field that is sampled; and where some aim at it, too, which
// pays from nearer by.
constexpr double kSeldomFound = 0.5, kSeldomFoundAiming = 0.2;

bool far_from_fields(const Medium& medium, const SceneMedia& media, const Lights& lights, double seldom_found) {
  const auto [centre, radius] = medium.bounding_sphere();
  for (size_t f = 0; f < media.emissions().size(); ++f) {
    const FieldLight* const light = lights.field(f);
    if (light && light->seldom_found(centre, radius * radius / 3) > seldom_found) return true;
  }
  return false;
}

/// Of each medium, whether most of it is so far from a field that emits that directions drawn by the phase function
/// seldom find it.
std::vector<bool> far_from_fields(const SceneMedia& media, const Lights& lights, double seldom_found) {
  std::vector<bool> far;
  for (const Medium& m : media.media()) far.push_back(far_from_fields(m, media, lights, seldom_found));
  return far;
}

/// Whether all there is lies in one still grid, but for still fields that emit.
bool is_one_grid(const Plan& plan, const SceneMedia& media, const Lights& lights) {
  const auto& fields = media.emissions();
  return plan.media.size() == 1 && plan.media[0] == Precision::kLanes && !plan.instances && !plan.holdouts &&
         !plan.chromatic && !plan.surfaces && !plan.moving_media && !plan.layers.records && lights.all_solid() &&
         std::all_of(fields.begin(), fields.end(), LaneEmission::fits);
}

/// The share of new directions that would aim at fire: on the mean of what camera rays see of diffuse surfaces, or in
/// the middle of a medium far from it where that is more.
double share_aimed(const SceneMedia& media, const Lights& lights, const Surfaces* surfaces, std::span<const Ray> rays) {
  double most = 0;
  for (const Medium& m : media.media())
    if (far_from_fields(m, media, lights, kSeldomFoundAiming))
      most = std::max(most, lights.field_cones(m.bounding_sphere().centre).share());
  if (!surfaces) return most;
  RunningStatistics seen;
  for (const Ray& ray : rays) {
    const auto hit = surfaces->intersect(ray, kUnbounded, Surfaces::kMiddle, true);
    if (!hit || surfaces->bsdf(*hit).kind != Bsdf::Kind::kDiffuse) continue;
    const dvec3 outside = glm::dot(hit->normal, ray.d) < 0 ? hit->normal : -hit->normal;
    seen.add(lights.field_cones(ray.at(hit->t), outside).share());
  }
  return std::max(most, seen.mean);
}

}  // namespace

Plan make_plan(const Scene& scene, const SceneMedia& media, const Lights& lights, const Surfaces* surfaces,
               const Camera& camera, const LayerRequest& layers) {
  Plan plan;
  const auto& all = media.media();
  for (const Medium& m : all) plan.media.push_back(precision_for(m));
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
  std::vector<Ray> rays;
  if (plan.one_grid || plan.emission)
    for (const PathRequest& r : coarse_requests(scene, plan, camera, 24, 1)) rays.push_back(r.ray);
  // Points of lit balls are weighed against directions of phase functions and BSDFs alone.
  plan.aims_at_fire = plan.light_sampling && plan.lit_balls.empty() && !plan.layers.records &&
                      lights.any_scattered_field() && share_aimed(media, lights, surfaces, rays) > kLeastAimed;
  plan.far_from_fire = far_from_fields(media, lights, plan.aims_at_fire ? kSeldomFoundAiming : kSeldomFound);
  plan.seen_emission =
      plan.emission && plan.has_media() && !plan.moving_media && !plan.instances &&
      std::find(plan.media.begin(), plan.media.end(), Precision::kDouble) == plan.media.end() &&
      std::none_of(all.begin(), all.end(), [](const Medium& m) { return m.falls_off() || m.detail(); }) &&
      std::all_of(fields.begin(), fields.end(), LaneEmission::fits);
  if (plan.one_grid && (!plan.emission || plan.seen_emission))  // else emission is integrated along free flights
    plan.first_collision = choose_first_collision(all[0], rays, scene.render.first_collision);
  plan.splits_camera_rays = plan.seen_emission && !plan.layers.records;
  return plan;
}

}  // namespace brume
