#include "render/session/flash_lamp.h"

#include <algorithm>
#include <numeric>
#include <optional>

#include "render/transport/wavefront.h"
#include "volume/gradient.h"

namespace brume {
namespace {

/// To the upper right of the eye, a fifth of the media's radius away.
dvec3 offset_lamp(const Camera& camera, const FilmSettings& film, double distance, double radius) {
  const double w = film.width, h = film.height;
  const auto across = [&](const dvec2& from, const dvec2& to) {
    return glm::normalize(camera.ray(to).at(distance) - camera.ray(from).at(distance));
  };
  return 0.2 * radius * glm::normalize(across({0, 0.5 * h}, {w, 0.5 * h}) + across({0.5 * w, h}, {0.5 * w, 0}));
}

/// The median length of the density gradient where rays meet the medium's isosurface.
double typical_gradient(const PathContext& context, const std::vector<PathRequest>& requests) {
  const Medium& medium = context.media[0];
  const auto iso = static_cast<float>(context.isosurface_density * medium.maximum_density());
  std::vector<double> steepness;
  for (const PathRequest& request : requests) {
    medium.each_met(request.ray, kUnbounded, [&](const Medium& one, size_t) {
      const Ray local = one.to_local(request.ray);
      const std::optional<double> t = find_isosurface(one, local, iso);
      if (!t) return;
      if (const auto g = density_gradient(one, local.at(*t + 0.5 / glm::length(local.d))))
        steepness.push_back(glm::length(*g));
    });
  }
  if (steepness.empty()) return 0;
  const auto middle = steepness.begin() + static_cast<std::ptrdiff_t>(steepness.size() / 2);
  std::nth_element(steepness.begin(), middle, steepness.end());
  return *middle;
}

}  // namespace

FlashLamp calibrated_flash_lamp(const PathContext& context, const Scene& scene, const Camera& camera,
                                const Medium::Sphere& bounds) {
  constexpr int kGrid = 48;
  constexpr size_t kSamples = 4;
  FlashLamp lamp;
  const dvec3 eye = camera.ray({0.5 * scene.film.width, 0.5 * scene.film.height}).o;
  lamp.distance = glm::distance(eye, bounds.centre);
  if (!(lamp.distance > 0)) lamp.distance = 1;
  const std::string& relief = scene.render.flash_relief;
  lamp.falloff = relief != "none" && relief != "gradient";
  lamp.shading = relief != "none" && relief != "falloff";
  if (relief == "offset") lamp.offset = offset_lamp(camera, scene.film, lamp.distance, bounds.radius);
  lamp.intensity = 1;

  const std::vector<PathRequest> requests = coarse_requests(scene, context.plan, camera, kGrid, kSamples);
  std::vector<PathRequest> last_of_pixel;
  for (size_t i = kSamples - 1; i < requests.size(); i += kSamples) last_of_pixel.push_back(requests[i]);
  lamp.typical_gradient = typical_gradient(context, last_of_pixel);

  // Summed in the requests' order: the lamp is the same whatever the tracer's.
  PathContext with_lamp = context;
  with_lamp.flash = lamp;
  std::vector<double> indirects(requests.size()), flashes(requests.size());
  PathCounters counters;
  const auto keep = [&](size_t i, const PathSample& s) {
    indirects[i] = luminance(s.indirect);
    flashes[i] = luminance(s.flash - s.direct);
  };
  trace_paths(with_lamp, requests, keep, counters);
  const double indirect = std::accumulate(indirects.begin(), indirects.end(), 0.0);
  const double flash = std::accumulate(flashes.begin(), flashes.end(), 0.0);
  lamp.intensity = flash > 0 ? indirect / flash : 0.0;
  return lamp;
}

}  // namespace brume
