#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "base/progress.h"
#include "render/scene/scene.h"
#include "render/transport/integrator.h"
#include "render/world/camera.h"
#include "render/world/media.h"

namespace brume {

/// What covers the pixels of a picture: things, and the share of each pixel that each hides of what is behind it. All
/// shares of a pixel add up to its alpha.
struct MatteRecord {
  struct Thing {
    std::string object, material;
  };
  struct Share {
    uint32_t thing;  ///< in `things`
    float coverage;
  };
  std::vector<Thing> things;               ///< of one object and material once
  std::vector<std::vector<Share>> pixels;  ///< of the window, row by row; each thing once, in the order of `things`
};

/// Marches camera rays through the media of a scene to the first surface, without a random number: a volume covers
/// what it takes of the light from behind it; where several overlap, each what it takes at that place. Coverage of
/// chromatic media is the mean of the three colours'. Holdouts hide and cover nothing, lights neither.
///
/// A pixel has five rays, or one where it is small against the voxels; 21 where those differ, 89 at edges; points of
/// Fibonacci lattices on the pixel, so that a straight edge of any direction is known to a few hundredths at worst.
/// What none of the first rays and none of the pixel's corners meets is missed.
/// @param corner  of the window, in pixels of the whole picture
/// Test: tests/render/matte_pixels_test.cpp
MatteRecord record_mattes(const Scene& scene, const SceneMedia& media, const PathContext& context, const Camera& camera,
                          const ivec2& corner, const ivec2& size, const Task& task);

}  // namespace brume
