#pragma once
#include <span>

#include "volume/emission.h"
#include "volume/medium.h"

namespace brume {

/// How camera rays find their first collision: see lanes_fly_first.
struct FirstCollision {
  bool forced = false;
  int paths = 1;  ///< that go on from a camera ray through a field that emits, with a first event each: CameraSplits
  double majorant = 1;  ///< factor on the majorants of forced flights
};

/// Chooses how many paths go on from a camera ray through fields that emit: 1, 2, 4 or 8, but not more than voxels that
/// its walk through the fields crosses for each scattering of a path.
/// @param rays    camera rays, spread over the picture, world space
/// @param forced  whether their first collisions are
int choose_paths(std::span<const Medium> media, std::span<const EmissionField> fields, std::span<const Ray> rays,
                 bool forced);

/// Chooses forced first collisions where camera rays scatter little of their light; in thick media every ray collides
/// anyway (docs/performance.md has the numbers). A forced flight draws its vertex from its tentative collisions, so
/// majorants are raised until there are several on a ray.
/// @param rays     camera rays, spread over the picture, world space
/// @param setting  auto, forced or free
FirstCollision choose_first_collision(const Medium& medium, std::span<const Ray> rays, std::string_view setting);

}  // namespace brume
