#include "render/transport/first_collision.h"

#include <algorithm>
#include <cmath>

#include "render/transport/camera_splits.h"
#include "volume/tracking.h"

namespace brume {
namespace {

constexpr double kThick = 0.75;    // share of the light scattered from which on forcing costs more than it gains
constexpr double kTentative = 8;   // tentative collisions wanted on a ray
constexpr double kMostLoose = 16;  // largest factor on the majorants: look-ups have a cost

// Most paths of a ray. Where first collisions are forced each of them scatters; elsewhere many pass by, or meet what
// other rays see without such a walk (docs/history.md).
constexpr int kMostForced = 8, kMostFree = 4;

/// Voxels that a ray crosses in the cells of a field that may emit.
double voxels_crossed(const Medium& shape, const Ray& local) {
  MajorantWalk walk = shape.walk(local, 0.0, kUnbounded);
  MajorantWalk::Segment s;
  double length = 0;
  while (walk.next(s))
    if (s.majorant > 0) length += s.t1 - s.t0;
  return length * glm::length(local.d);
}

double majorant_depth(const Medium& medium, const Ray& local) {
  MajorantWalk walk = medium.walk(local, 0.0, kUnbounded);
  MajorantWalk::Segment s;
  double depth = 0;
  while (walk.next(s)) depth += (s.t1 - s.t0) * s.majorant;
  return depth * medium.extinction_per_density();
}

}  // namespace

int choose_paths(std::span<const Medium> media, std::span<const EmissionField> fields, std::span<const Ray> rays,
                 bool forced) {
  double voxels = 0, scatterings = 0;
  for (const Ray& ray : rays) {
    double crossed = 0;
    for (const EmissionField& field : fields) crossed += voxels_crossed(field.shape(), field.shape().to_local(ray));
    if (!(crossed > 0)) continue;
    voxels += crossed;
    double depth = 0, albedo = 0;
    for (const Medium& m : media) {
      depth += optical_depth(m, m.to_local(ray), kUnbounded);
      albedo = std::max(albedo, max_component(m.albedo()));
    }
    // Of a random walk, or until roulette ends it.
    const double stays = CameraSplits::survival(CameraSplits::kFirstRoulette, albedo);
    scatterings += 1 + std::min(depth * depth, 2 + (stays < 1 ? stays / (1 - stays) : kUnbounded));
  }
  int paths = 1;
  while (2 * paths <= (forced ? kMostForced : kMostFree) && 2 * paths * scatterings <= voxels) paths *= 2;
  return paths;
}

FirstCollision choose_first_collision(const Medium& medium, std::span<const Ray> rays, std::string_view setting) {
  FirstCollision first;
  if (setting == "free") return first;
  double scattered = 0, tentative = 0, met = 0;
  for (const Ray& ray : rays) {
    const Ray local = medium.to_local(ray);
    const double bound = majorant_depth(medium, local);
    if (!(bound > 0)) continue;
    ++met;
    tentative += bound;
    scattered -= std::expm1(-optical_depth(medium, local, kUnbounded));
  }
  if (!(met > 0)) return first;
  first.forced = setting == "forced" || scattered / met < kThick;
  if (first.forced) first.majorant = std::clamp(kTentative * met / tentative, 1.0, kMostLoose);
  return first;
}

}  // namespace brume
