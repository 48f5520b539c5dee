#pragma once
#include <span>

#include "volume/medium.h"

namespace brume {

/// How camera rays find their first collision: see lanes_fly_first.
struct FirstCollision {
  bool forced = false;
  double majorant = 1;  ///< factor on the majorants of the first flight
};

/// Forcing pays where rays scatter little of their light, and needs several tentative collisions a ray to choose from:
/// the majorants are raised for that. In thick media every ray collides anyway (docs/performance.md has the numbers).
/// @param rays     camera rays, spread over the picture, world space
/// @param setting  auto, forced or free
FirstCollision choose_first_collision(const Medium& medium, std::span<const Ray> rays, std::string_view setting);

}  // namespace brume
