#include "render/world/everywhere.h"

#include <algorithm>

#include "render/world/camera.h"

namespace brume {
namespace {

/// Box around the eye, as the shutter opens and closes, and the lamps. @param to_local  of its coordinates
EverywhereBox box_of_eye_and_lamps(const Scene& scene, const dmat3& to_local) {
  const Camera camera(scene.camera, scene.film.width, scene.film.height);
  EverywhereBox box{to_local * camera.position(0), to_local * camera.position(0)};
  const auto enclose = [&](const dvec3& p) {
    box.lo = glm::min(box.lo, to_local * p);
    box.hi = glm::max(box.hi, to_local * p);
  };
  enclose(camera.position(1));
  for (const LightSettings& light : scene.lights)
    if (light.type != "sun") enclose(light.position);
  return box;
}

/// Ten mean free paths in the channel of least extinction that has any.
double reach_of(const dvec3& sigma_t) {
  double least = 0;
  for (int c = 0; c < 3; ++c)
    if (sigma_t[c] > 0) least = least > 0 ? std::min(least, sigma_t[c]) : sigma_t[c];
  return least > 0 ? kMeanFreePaths / least : 1.0;
}

}  // namespace

EverywhereBox everywhere_box(const Scene& scene, const VolumeSettings& volume) {
  const EverywhereBox box = box_of_eye_and_lamps(scene, dmat3(1));
  const double reach = reach_of(volume.sigma_t);
  return {box.lo - reach, box.hi + reach};
}

LayerPlace layer_place(const Scene& scene, const VolumeSettings& v) {
  const dvec3 up = glm::normalize(v.up.empty() ? scene.environment.up : dvec3(v.up[0], v.up[1], v.up[2]));
  if (!is_endless_layer(v)) return {dmat4(1), {v.lo, v.hi}, {up / v.scale_height, v.base_height / v.scale_height}};
  constexpr double kLeft = 1e-3, kThinnest = 0.1, kScalesBelow = 2;
  constexpr double kAside = 2;  // times as far: of what a ray just above the horizon passes, most lies far away
  const Frame frame(up);
  const dmat3 world_from_local(frame.x, frame.y, frame.z);
  EverywhereBox box = box_of_eye_and_lamps(scene, glm::transpose(world_from_local));
  const double reach = reach_of(v.sigma_t), base = v.base_height, scale = v.scale_height;
  const double density = std::exp(-std::max(0.0, box.hi.z - base) / scale);
  const double aside = kAside * reach / std::max(density, kThinnest);
  const double depth = max_component(v.sigma_t) * scale;
  box.lo -= dvec3(aside, aside, 0);
  box.hi += dvec3(aside, aside, 0);
  box.hi.z = std::max(box.hi.z, base + scale * std::log(std::max(1.0, depth) / kLeft));
  box.lo.z = std::min(box.lo.z, base) - std::min(reach, kScalesBelow * scale);
  return {dmat4(world_from_local), box, {{0, 0, 1 / scale}, base / scale}};
}

dvec3 light_from_infinity(const Scene& scene) {
  dvec3 passes(1);
  for (const VolumeSettings& v : scene.volumes)
    for (int c = 0; c < 3; ++c)
      if (is_everywhere(v) && v.sigma_t[c] > 0) passes[c] = 0;
  return passes;
}

}  // namespace brume
