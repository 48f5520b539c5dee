#pragma once
#include "render/scene/scene.h"
#include "volume/height_falloff.h"

namespace brume {

struct EverywhereBox {
  dvec3 lo, hi;
};

/// Where shape = "everywhere" ends, in world coordinates: kMeanFreePaths, in the channel of least extinction that has
/// any, beyond the camera as the shutter opens and closes and beyond the lamps.
/// @throws InputError  where the camera is taken from an EXR that has none
EverywhereBox everywhere_box(const Scene& scene, const VolumeSettings& volume);
constexpr double kMeanFreePaths = 10;

/// A layer of fog in coordinates of its own.
struct LayerPlace {
  dmat4 object_from_local{1};
  EverywhereBox box;        ///< local
  HeightFalloff falloff{};  ///< local
};

/// Where shape = "layer" lies. Without lo and hi it ends: at the sides, twenty mean free paths of the air around the
/// eye and the lamps away, but no more than 200 of its densest part; above, where a thousandth of its optical depth is
/// left, and above the eye and the lamps; below, ten mean free paths or two scale heights under its base, the eye and
/// the lamps, whichever is less.
/// @throws InputError  as everywhere_box
LayerPlace layer_place(const Scene& scene, const VolumeSettings& volume);

/// 1 in the channels that reach the scene from infinitely far, 0 where a medium is everywhere.
dvec3 light_from_infinity(const Scene& scene);

}  // namespace brume
