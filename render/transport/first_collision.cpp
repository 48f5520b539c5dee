#include "render/transport/first_collision.h"

#include <algorithm>
#include <cmath>

#include "volume/tracking.h"

namespace brume {
namespace {

constexpr double kThick = 0.75;    // share of the light scattered from which on forcing costs more than it gains
constexpr double kTentative = 8;   // tentative collisions wanted on a ray
constexpr double kMostLoose = 16;  // largest factor on the majorants: look-ups have a cost

double majorant_depth(const Medium& medium, const Ray& local) {
  MajorantWalk walk = medium.walk(local, 0.0, kUnbounded);
  MajorantWalk::Segment s;
  double depth = 0;
  while (walk.next(s)) depth += (s.t1 - s.t0) * s.majorant;
  return depth * medium.extinction_per_density();
}

}  // namespace

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
