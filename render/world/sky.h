#pragma once
#include "image/color_space.h"
#include "image/layers.h"
#include "render/scene/scene.h"

namespace brume {

/// A lat-long picture's frame: its middle faces `forward`, as Environment places it.
struct SkyFrame {
  dvec3 up, forward, right;
  explicit SkyFrame(const dvec3& up_direction);
};

/// A clear daylight sky as a lat-long picture in linear Rec. 709, luminance in kcd/m^2. Below
/// the horizon lies a diffuse ground lit by that sky, and by its sun where that is part of it.
/// Source: Preetham, Shirley, Smits 1999, A Practical Analytic Model for Daylight, appendix A.2.
/// @param settings  their sun is held above the horizon; their radiance is left to the caller
Layers preetham_sky(const EnvironmentSettings& settings);

/// The sun that belongs to it, its colour and strength after the atmosphere: illuminance in klux.
/// @param space  of the settings' radiance and of the sun
/// Source: Preetham, Shirley, Smits 1999, appendix A.1 (Rayleigh, aerosol, ozone at the three primaries).
LightSettings preetham_sun(const EnvironmentSettings& settings, const WorkingSpace& space = {});

}  // namespace brume
