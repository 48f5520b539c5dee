#pragma once
#include <span>

#include "render/transport/path_counts.h"
#include "volume/medium.h"

namespace brume {

/// How camera rays find their first collision: see lanes_fly_first.
struct FirstCollision {
  bool forced = false;
  PathCounts paths;     ///< that go on from camera rays in scenes that emit, with a first event each: CameraSplits
  double majorant = 1;  ///< factor on the majorants of forced flights
};

/// Chooses forced first collisions where camera rays scatter little of their light; in thick media every ray collides
/// anyway (docs/performance.md has the numbers). A forced flight draws its vertex from its tentative collisions, so
/// majorants are raised until there are several on a ray.
/// @param rays     camera rays, spread over the picture, world space
/// @param setting  auto, forced or free
FirstCollision choose_first_collision(const Medium& medium, std::span<const Ray> rays, std::string_view setting);

}  // namespace brume
