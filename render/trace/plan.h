#pragma once
#include <vector>

#include "render/trace/first_collision.h"
#include "render/trace/near_light.h"
#include "render/trace/path_sample.h"
#include "render/world/lights.h"
#include "render/world/media.h"

namespace brume {

class Camera;
class Surfaces;

/// Suns that the lanes' kernels can hold.
inline constexpr size_t kMostLaneSuns = 16;

/// What exists in this render, decided once: the inner loop is instantiated for it and models nothing else.
struct Plan {
  enum class Media { kNone, kOneGrey, kManyGrey, kChromatic } media = Media::kNone;
  bool moving_media = false;    ///< some change over the shutter
  bool light_sampling = false;  ///< next-event estimation towards at least one light
  bool finite_lights = false;   ///< analytic lights that rays can end on
  bool surfaces = false;        ///< triangle meshes
  bool emission = false;        ///< fields that emit
  bool lens = false, shutter = false;
  bool lanes = false;                  ///< the paths run side by side in SIMD lanes (render/lanes/wavefront.h)
  bool one_grid = false;               ///< in lanes: in the local coordinates of the one grid that there is
  bool interpolate = false;            ///< in lanes: interpolate all eight voxels around a point, not one at random
  FirstCollision first_collision;      ///< of camera rays, in lanes
  std::vector<NearLight> near_lights;  ///< small lights in homogeneous media, sampled along flights too

  // Recorded beyond what the path computes anyway.
  bool medium_surface = false;  ///< intersected once per path
  bool first_event = false;     ///< where and at what the path scatters first
  bool first_surface = false;   ///< what surface it meets first, and what shadow catchers gather
  bool first_scatter_gradient = false;
  bool weighted_gradient = false;  ///< marched once per path
  bool optical_depth = false;      ///< marched once per path
  bool flash = false;

  LayerRequest layers;

  bool marched() const { return weighted_gradient || optical_depth; }
  bool has_media() const { return media != Media::kNone; }
};

Plan make_plan(const Scene& scene, const SceneMedia& media, const Lights& lights, const Surfaces* surfaces,
               const Camera& camera, const LayerRequest& layers);

}  // namespace brume
