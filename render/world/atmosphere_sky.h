#pragma once
#include <vector>

#include "base/progress.h"
#include "image/layers.h"
#include "render/scene/scene.h"

namespace brume {

/// sky = "atmosphere" of a scene: the light of Atmosphere as a lat-long picture and a sun. With `air` both are what
/// arrives where the scene's own air (air_of) ends in their direction, seen from the camera as the shutter opens: that
/// air scatters and dims on its own, and what is seen through it is the whole sky.
class AtmosphereSky {
 public:
  /// @throws InputError  where the camera is taken from an EXR that has none
  AtmosphereSky(const Scene& scene, const Task& task);

  /// A lat-long picture in linear Rec. 709, luminance in kcd/m^2; below the horizon the ground, with the air in
  /// front of it.
  const Layers& picture() const { return picture_; }
  /// Illuminance in klux times the scene's radiance, in the scene's space, black where it is below the horizon; its
  /// disc is even, of the mean colour that the air leaves of it.
  const LightSettings& sun() const { return sun_; }

 private:
  Layers picture_;
  LightSettings sun_;
};

/// The air around the camera as media of the scene: two layers, Rayleigh's and the aerosol, in a box that reaches `air`
/// to the sides, a tenth of it upwards, and down to the sea. No volumes where `air` is 0.
/// @throws InputError  as AtmosphereSky
std::vector<VolumeSettings> air_of(const Scene& scene);

}  // namespace brume
