#include "render/session/scene_notes.h"

#include <fmt/format.h>

#include <algorithm>

#include "render/world/everywhere.h"

namespace brume {
namespace {

bool has_role(const Scene& scene, const char* role) {
  return std::any_of(scene.surfaces.begin(), scene.surfaces.end(),
                     [&](const SurfaceSettings& s) { return s.role == role; });
}

bool has_sun(const Scene& scene) {
  return std::any_of(scene.lights.begin(), scene.lights.end(), [](const LightSettings& l) { return l.type == "sun"; });
}

bool has_traced_glass(const Scene& scene) {
  return std::any_of(scene.surfaces.begin(), scene.surfaces.end(),
                     [](const SurfaceSettings& s) { return s.material == "dielectric" && s.shadow == "traced"; });
}

}  // namespace

std::vector<std::string> scene_notes(const Scene& scene, const SceneMedia& media, const Lights& lights,
                                     const LayerRequest& layers) {
  std::vector<std::string> notes;
  const bool no_sampling = scene.render.light_sampling == "none", catcher = has_role(scene, "shadow_catcher");
  if (catcher && !layers.has(layer::catcher))
    notes.push_back(
        "a shadow catcher is unseen in the picture itself: record what it shows with --layers ...,catcher,catcher_unshadowed");
  if (catcher && no_sampling)
    notes.push_back(
        "shadow catchers gather light by light sampling alone: with light_sampling = \"none\" light does not reach them");
  if (has_traced_glass(scene) && lights.any_delta())
    notes.push_back(
        "no path finds points, spots and exactly parallel suns through dielectric meshes: behind them their light is missing. Give them a radius or an angular_diameter, the larger the less noise, or the meshes shadow = \"straight\"");
  if (has_everywhere(scene) && light_from_infinity(scene) != dvec3(1) &&
      (scene.environment.radiance != dvec3(0) || has_sun(scene)))
    notes.push_back(
        "a volume is everywhere: no light of the environment or a sun comes through it from infinitely far");
  const bool shutter_opens = scene.camera.shutter.y > scene.camera.shutter.x;
  const CameraSettings& camera = scene.camera;
  if (!shutter_opens && !(camera.position_end.empty() && camera.look_at_end.empty() && camera.up_end.empty()))
    notes.push_back("the camera moves but camera.shutter opens and closes at once: it stands where it starts");
  const auto moves = [](const SurfaceSettings& s) { return s.object_to_world_end != dmat4(0.0); };
  if (!shutter_opens && std::any_of(scene.surfaces.begin(), scene.surfaces.end(), moves))
    notes.push_back("a surface moves but camera.shutter opens and closes at once: it is rendered where it starts");
  if (scene.volumes.empty() && scene.surfaces.empty())
    notes.push_back("the scene has no [[volumes]]: there is nothing to scatter light");
  const std::vector<std::string> of_lights = lights.notes();
  notes.insert(notes.end(), of_lights.begin(), of_lights.end());
  if (!lights.any() && media.emissions().empty()) notes.push_back("the scene has no light: the picture will be black");
  return notes;
}

}  // namespace brume
