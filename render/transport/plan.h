#pragma once
#include <vector>

#include "render/transport/first_collision.h"
#include "render/transport/lit_balls.h"
#include "render/transport/near_light.h"
#include "render/transport/path_sample.h"
#include "render/world/lights.h"
#include "render/world/media.h"

namespace brume {

class Camera;
class Surfaces;

/// How rays go through a medium: in closed form; in SIMD lanes; or one after the other in double precision, where
/// single precision does not resolve the grid.
enum class Precision { kClosedForm, kLanes, kDouble };
Precision precision_for(const Medium& medium);

/// What exists in this render, decided once: paths model nothing else.
struct Plan {
  std::vector<Precision> media;     ///< of each that scatters or absorbs
  bool chromatic = false;           ///< the extinction of some has a colour
  bool instances = false;           ///< some stand at many places
  bool holdouts = false;            ///< some are not seen and hide what is behind them
  bool moving_media = false;        ///< some change over the shutter
  bool light_sampling = false;      ///< next-event estimation towards at least one light
  bool aims_at_fire = false;        ///< vertices that sample fields that emit draw directions towards them, too
  std::vector<bool> far_from_fire;  ///< by medium: its vertices sample fields that emit, as those on surfaces do
  bool finite_lights = false;       ///< analytic lights that rays can end on
  bool surfaces = false;            ///< triangle meshes
  bool emission = false;            ///< fields that emit
  bool seen_emission = false;       ///< integrated along camera rays, through media that stand still
  bool splits_camera_rays = false;  ///< several paths may go on from one: FirstCollision::paths
  bool lens = false, shutter = false;
  bool one_grid = false;               ///< paths live in the local coordinates of the one grid that there is
  bool interpolate = false;            ///< interpolate all eight voxels around a point, do not draw one
  FirstCollision first_collision;      ///< of camera rays, where one_grid
  std::vector<NearLight> near_lights;  ///< small lights in homogeneous media, sampled along flights too

  std::vector<LitBall> lit_balls;  ///< smoke around lamps, which vertices aim at

  // Recorded beyond what the path computes anyway.
  bool isosurface = false;     ///< intersected once per path
  bool first_event = false;    ///< where and at what the path scatters first
  bool first_surface = false;  ///< what surface it meets first, and what shadow catchers gather
  bool first_scatter_gradient = false;
  bool weighted_gradient = false;  ///< marched once per path
  bool optical_depth = false;      ///< marched once per path
  bool flash = false;

  LayerRequest layers;

  bool samples_fields(size_t medium) const { return medium < far_from_fire.size() && far_from_fire[medium]; }
  bool marched() const { return weighted_gradient || optical_depth; }
  bool has_media() const { return !media.empty(); }
};

Plan make_plan(const Scene& scene, const SceneMedia& media, const Lights& lights, const Surfaces* surfaces,
               const Camera& camera, const LayerRequest& layers);

}  // namespace brume
