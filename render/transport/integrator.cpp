#include "render/transport/integrator.h"

#include <algorithm>
#include <cmath>

#include "render/world/camera.h"

namespace brume {

void LimitedLight::merge(const LimitedLight& other) {
  paths += other.paths;
  taken += other.taken;
  found += other.found;
}

double limit_indirect(double limit, dvec3& indirect, LimitedLight& count) {
  const double found = (indirect.x + indirect.y + indirect.z) / 3;
  if (!(limit > 0) || !std::isfinite(found)) return 1;
  count.found += found;
  if (!(found > limit)) return 1;
  ++count.paths;
  count.taken += found - limit;
  indirect *= limit / found;
  return limit / found;
}

void PathCounters::merge(const PathCounters& other) {
  tracking.merge(other.tracking);
  paths += other.paths;
  capped_paths += other.capped_paths;
  capped_throughput += other.capped_throughput;
  longest = std::max(longest, other.longest);
  limited.merge(other.limited);
}

std::span<const Medium> media_at(const PathContext& context, double time) {
  if (!context.plan.moving_media) return context.media;
  static thread_local std::vector<Medium> moved;
  moved.clear();
  for (const Medium& m : context.media) moved.push_back(m.at_time(time));
  return moved;
}

PathRequest camera_request(const Scene& scene, const Plan& plan, const Camera& camera, int64_t seed, int x, int y,
                           uint32_t sample, const EntryBound& start) {
  PathRequest r;
  r.start = start;
  // Below 2^32: a film has at most 65536 x 65536 pixels.
  const uint32_t pixel = static_cast<uint32_t>(y) * static_cast<uint32_t>(scene.film.width) + static_cast<uint32_t>(x);
  const int frame = scene.render.noise_frame >= 0 ? scene.render.noise_frame : scene.render.frame;
  r.key = {static_cast<uint64_t>(seed), static_cast<uint32_t>(frame), pixel, sample};
  const Sobol sobol(r.key);
  if (plan.shutter) r.time = sobol.pair(2).x;
  r.ray = camera.ray(dvec2(x, y) + sobol.pair(0), plan.lens ? sobol.pair(1) : dvec2(0.5), r.time);
  return r;
}

std::vector<PathRequest> coarse_requests(const Scene& scene, const Plan& plan, const Camera& camera, int columns,
                                         int rows, int row, uint32_t samples) {
  constexpr int64_t kSeed = 0x5eedf1a5;
  std::vector<PathRequest> requests;
  const int y = (2 * row + 1) * scene.film.height / (2 * rows);
  for (int i = 0; i < columns; ++i) {
    const int x = (2 * i + 1) * scene.film.width / (2 * columns);
    for (uint32_t s = 0; s < samples; ++s) requests.push_back(camera_request(scene, plan, camera, kSeed, x, y, s));
  }
  return requests;
}

std::vector<PathRequest> coarse_requests(const Scene& scene, const Plan& plan, const Camera& camera, int grid,
                                         uint32_t samples) {
  std::vector<PathRequest> requests;
  for (int j = 0; j < grid; ++j) {
    const std::vector<PathRequest> row = coarse_requests(scene, plan, camera, grid, grid, j, samples);
    requests.insert(requests.end(), row.begin(), row.end());
  }
  return requests;
}

}  // namespace brume
