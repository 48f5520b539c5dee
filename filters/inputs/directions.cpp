#include "filters/inputs/directions.h"

#include <algorithm>

#include "filters/inputs/planes.h"

namespace brume {

// Shorter means are noise: paths that disagree about where the surface faces.
constexpr float kCoherenceFloor = 1e-3f;

std::vector<Plane> unit_directions(const RgbPlanes& mean, const Task& task) {
  std::vector<Plane> out(4, Plane(mean[0]->width(), mean[0]->height()));
  for_each_row(out[0].height(), quiet(task), [&](int y) {
    for (int x = 0; x < out[0].width(); ++x) {
      const vec3 v = color_at(mean, x, y);
      const float length = glm::length(v);
      const bool defined = length >= kCoherenceFloor;
      const vec3 unit = defined ? v / length : vec3(0);
      for (int c = 0; c < 3; ++c) out[static_cast<size_t>(c)](x, y) = unit[c];
      out[3](x, y) = defined ? 1.0f : 0.0f;
    }
  });
  return out;
}

std::vector<Plane> unit_directions(const FilterFrame& frame, const Task& task) {
  const bool chosen = std::any_of(frame.features->begin(), frame.features->end(),
                                  [](const Feature& f) { return f.name == "gradient"; });
  if (!chosen) return {};
  const LayerName& weighted = layer::gradient_transmittance_weighted;
  return unit_directions(frame.layers.rgb(frame.layers.has(weighted) ? weighted : layer::gradient), task);
}

}  // namespace brume
