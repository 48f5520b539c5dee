#pragma once
#include "render/scene/scene.h"

namespace brume {

struct EverywhereBox {
  dvec3 lo, hi;
};

/// Where shape = "everywhere" ends, in world coordinates: kMeanFreePaths, in the channel of least extinction that has
/// any, beyond the camera as the shutter opens and closes and beyond the lamps.
/// @throws InputError  where the camera is taken from an EXR that has none
EverywhereBox everywhere_box(const Scene& scene, const VolumeSettings& volume);
constexpr double kMeanFreePaths = 10;

/// 1 in the channels that reach the scene from infinitely far, 0 where a medium is everywhere.
dvec3 light_from_infinity(const Scene& scene);

}  // namespace brume
