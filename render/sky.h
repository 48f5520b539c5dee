#pragma once
#include "image/layers.h"
#include "render/scene.h"

namespace brume {

/// A clear daylight sky as a lat-long picture of the kind EnvironmentSettings::file takes, luminance in kcd/m^2. Below
/// the horizon lies a diffuse ground lit by that sky.
/// Source: Preetham, Shirley, Smits 1999, A Practical Analytic Model for Daylight, appendix A.2.
/// @param turbidity      1.9 .. 10
/// @param sun_direction  towards the sun; held above the horizon
Layers preetham_sky(double turbidity, const dvec3& sun_direction, const dvec3& up, double ground_albedo);

/// The sun that belongs to it, its colour and strength after the atmosphere: illuminance in klux.
/// Source: Preetham, Shirley, Smits 1999, appendix A.1 (Rayleigh, aerosol, ozone at the three primaries).
LightSettings preetham_sun(const EnvironmentSettings& settings);

}  // namespace brume
