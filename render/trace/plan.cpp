#include "render/trace/plan.h"

#include <algorithm>

#include "render/trace/integrator.h"
#include "render/world/camera.h"
#include "render/world/surfaces.h"
#include "volume/lane_grid.h"

namespace brume {
namespace {

/// Whether single precision holds a medium: a homogeneous one, or a grid that LaneGrid fits and resolves.
bool fits_lanes(const Medium& m) {
  if (m.homogeneous()) return true;
  if (const Displacement* const d = m.displacement()) {
    for (const BrickGrid& part : d->field.parts)
      if (!part.empty() && !LaneGrid::fits(part)) return false;
    if (!LaneGrid::fits(d->envelope)) return false;
  }
  const double longest_voxel = m.voxel_volume() / (m.voxel_size() * m.voxel_size());  // at least its longest edge
  const double free_path = 1 / (m.extinction_per_density() * m.maximum_density() * longest_voxel);
  return !m.global_majorant() && LaneGrid::fits(m.bricks()) && LaneGrid::resolves(m.bricks(), free_path);
}

/// Whether the lanes can trace it: all that fits. Not yet emission in chromatic media: at
/// each point of a flight it has the weights of the collisions before.
bool fits_lanes(const Plan& plan, const SceneMedia& media, const Lights& lights) {
  if (plan.media == Plan::Media::kChromatic && plan.emission) return false;
  for (const EmissionField& e : media.emissions())
    if (!e.moves() && !e.shape().homogeneous() && !LaneGrid::fits(e.shape().bricks())) return false;
  const auto& all = media.media();
  return std::all_of(all.begin(), all.end(), [](const Medium& m) { return fits_lanes(m); }) &&
         (lights.local() || lights.suns().size() <= kMostLaneSuns);
}

/// Whether all there is lies in one still grid, but for still fields that emit.
bool is_one_grid(const Plan& plan, const SceneMedia& media) {
  const auto& glow = media.emissions();
  return plan.media == Plan::Media::kOneGrey && !plan.surfaces && !plan.moving_media &&
         !media.media()[0].homogeneous() && std::none_of(glow.begin(), glow.end(), [](const EmissionField& e) {
           return e.moves() || e.shape().homogeneous().has_value();
         });
}

}  // namespace

Plan make_plan(const Scene& scene, const SceneMedia& media, const Lights& lights, const Surfaces* surfaces,
               const Camera& camera, const LayerRequest& layers) {
  Plan plan;
  const auto& all = media.media();
  if (std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.chromatic(); }))
    plan.media = Plan::Media::kChromatic;
  else if (!all.empty())
    plan.media = all.size() == 1 ? Plan::Media::kOneGrey : Plan::Media::kManyGrey;
  plan.moving_media = std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.moves(); });
  plan.surfaces = surfaces != nullptr;
  plan.light_sampling = (plan.has_media() || plan.surfaces) && lights.any_sampled();
  plan.finite_lights = !lights.finite().empty();
  plan.emission = !media.emissions().empty();
  plan.lens = camera.has_lens();
  const auto& glow = media.emissions();
  plan.shutter = camera.moves() || plan.moving_media ||
                 std::any_of(glow.begin(), glow.end(), [](const EmissionField& e) { return e.moves(); });
  if (plan.has_media()) {
    plan.medium_surface = layers.has(layer::gradient) || layers.has(layer::coverage) || layers.records;
    plan.flash = layers.has(layer::flash);
    for (const LayerName& l : {layer::scatter_depth, layer::scatter_position, layer::scatter_density,
                               layer::scatter_share, layer::albedo, layer::gradient_first_scatter, layer::flash})
      plan.first_event = plan.first_event || layers.has(l);
    plan.first_scatter_gradient = layers.has(layer::gradient_first_scatter) || plan.flash || layers.records;
    plan.weighted_gradient = layers.has(layer::gradient_transmittance_weighted);
    plan.optical_depth = layers.has(layer::optical_depth);
  }
  if (plan.surfaces)
    for (const LayerName& l :
         {layer::albedo, layer::normal, layer::depth, layer::position, layer::catcher, layer::catcher_unshadowed})
      plan.first_surface = plan.first_surface || layers.has(l);
  plan.layers = layers;
  plan.near_lights = choose_near_lights(all, lights, scene.render.near_lights);
  plan.interpolate = scene.render.lookup == "interpolated";
  plan.lanes = scene.render.lanes != "off" && !layers.records && fits_lanes(plan, media, lights);
  plan.one_grid = plan.lanes && is_one_grid(plan, media);
  if (plan.one_grid && !plan.emission) {  // emission is integrated along free flights
    std::vector<Ray> rays;
    for (const PathRequest& r : coarse_requests(scene, plan, camera, 24, 1)) rays.push_back(r.ray);
    plan.first_collision = choose_first_collision(all[0], rays, scene.render.first_collision);
  }
  return plan;
}

}  // namespace brume
