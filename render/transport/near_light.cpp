#include "render/transport/near_light.h"

namespace brume {

std::vector<NearLight> choose_near_lights(std::span<const Medium> media, const Lights& lights,
                                          std::string_view setting) {
  std::vector<NearLight> near;
  if (setting == "off") return near;
  for (const Light* light : lights.choice(false).lights()) {
    const dvec3* position = light->centre();
    if (!position) continue;
    double sigma = 0;
    for (const Medium& any : media)
      if (any.homogeneous())
        any.each_around(*position, [&](const Medium& m, size_t) {
          sigma += m.density(m.to_local(*position)) * m.extinction_per_density();
        });
    if (sigma > 0) near.push_back({light, *position, 0.2 / sigma});
  }
  return near;
}

}  // namespace brume
