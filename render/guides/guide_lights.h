#pragma once
#include <memory>
#include <vector>

#include "render/guides/guide_light.h"

namespace brume {

/// The lights of a scene by their guides: suns and lamps one by one while they are few, the weaker ones together;
/// everything infinitely far but the suns is the sky; what the media emit is a group, too.
/// @param colour  that they are wanted in: for kGrey a sky of many colours is three groups, its red, green and blue
std::vector<std::unique_ptr<GuideLight>> guide_lights(const Lights& lights, const GuideMedia& media,
                                                      GuideColour colour);
/// What surfaces send into the media, once LightSolve::surface_light is known.
std::unique_ptr<GuideLight> light_from_surfaces(const dvec3& colour);

}  // namespace brume
