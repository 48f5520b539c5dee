#include "render/world/everywhere.h"

#include <algorithm>

#include "render/world/camera.h"

namespace brume {

EverywhereBox everywhere_box(const Scene& scene, const VolumeSettings& volume) {
  const Camera camera(scene.camera, scene.film.width, scene.film.height);
  EverywhereBox box{camera.position(0), camera.position(0)};
  const auto enclose = [&](const dvec3& p) {
    box.lo = glm::min(box.lo, p);
    box.hi = glm::max(box.hi, p);
  };
  enclose(camera.position(1));
  for (const LightSettings& light : scene.lights)
    if (light.type != "sun") enclose(light.position);
  double least = 0;
  for (int c = 0; c < 3; ++c)
    if (volume.sigma_t[c] > 0) least = least > 0 ? std::min(least, volume.sigma_t[c]) : volume.sigma_t[c];
  const double reach = least > 0 ? kMeanFreePaths / least : 1.0;
  return {box.lo - reach, box.hi + reach};
}

dvec3 light_from_infinity(const Scene& scene) {
  dvec3 passes(1);
  for (const VolumeSettings& v : scene.volumes)
    for (int c = 0; c < 3; ++c)
      if (is_everywhere(v) && v.sigma_t[c] > 0) passes[c] = 0;
  return passes;
}

}  // namespace brume
