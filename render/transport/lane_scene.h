#pragma once
#include <cstddef>
#include <cstdint>

#include "render/transport/integrator.h"
#include "render/transport/lane_cells.h"
#include "render/transport/lane_detail.h"
#include "render/transport/path_states.h"
#include "volume/lane_grid.h"

// The scene as the SIMD kernels read it, in single precision.

namespace brume {

struct WorldPaths;

/// Suns that the kernels can hold.
inline constexpr size_t kMostLaneSuns = 16;

/// The lanes' unit of ray parameters, in world units: the power of two nearest to a voxel's size. In it, local
/// directions are about 1 long whatever the world's scale, and converting rounds nothing.
double lane_unit(const Medium& medium);

/// A medium of the scene, whose cells these are, and the scene's lights.
struct LaneScene : LaneCells {
  const uint8_t* distances;
  const int32_t* isosurface_cell;
  double unit;                   ///< lane_unit() of the medium: ray parameters in lanes are in these
  float sigma;                   ///< extinction per density and unit
  float local_from_world[3][3];  ///< of directions, in units; only where Plan::one_grid
  float gradient_to_world[3][3];
  float least_gradient;                  ///< per voxel; below it, wider central differences are needed
  float first_sigma;                     ///< the same for the majorants of forced flights, which may be looser
  float g = 0;                           ///< of the phase function, where it is Henyey-Greenstein's
  const PhaseFunction* phase = nullptr;  ///< the others
  float albedo[3];
  bool chromatic = false;          ///< the extinction has a colour
  float extinction_ratio[3] = {};  ///< of each channel to the largest
  bool coloured;                   ///< the albedo varies in space
  /// Where the density is displaced by its velocity: the cells above are the envelope's.
  bool displaced = false;
  LaneCells density;           ///< as it is stored
  LaneCells displacement[3];   ///< per frame; without values where it is 0
  float origin_shift[3] = {};  ///< from the density's coordinates to those of displacement and envelope
  float open = 0, close = 0;   ///< of the shutter, in frames
  LaneDetail detail;
  int roulette_start;
  int max_events;
  bool interpolate;
  float isosurface_density;

  struct SunLight {
    float x[3], y[3], z[3];  ///< a frame around its axis, world space
    float one_minus_cos, pdf, share_end, share;
    float radiance[3];
    bool delta;
    size_t group;  ///< Light::group
  };
  SunLight suns[kMostLaneSuns];
  size_t sun_count = 0;
  /// Chosen with the probability that the suns leave; null where it is not sampled.
  const Environment* environment = nullptr;
  float environment_share = 0;
  /// All lights, where one has a position, so that the choice between them depends on the point, or where records want
  /// to know what was drawn; else null, and the suns and the environment above are used.
  const Lights* lights = nullptr;
  bool samples_fields = false;             ///< Plan::samples_fields
  bool aims_at_fields = false;             ///< new directions are drawn from Lights::field_cones(), too
  std::span<const NearLight> near_lights;  ///< the part of their light that is left to collisions is sampled there
  const Medium* medium;
  WorldPaths* world;         ///< of the paths
  bool keeps_local = false;  ///< Plan::one_grid: paths stay in the medium's local coordinates from event to event
  bool grouped = false;      ///< whether the light sample's group is kept
  bool flights_end = false;  ///< whether flights can end before the grid does
  bool shadows_end = false;  ///< whether shadow rays can
  const StopSignal* stop;    ///< polled inside flights; may be null
};

/// A path's time in frames, where the density is displaced.
inline float frame_of(const LaneScene& scene, const PathStates& paths, size_t slot) {
  return scene.open + (scene.close - scene.open) * paths.time[slot];
}

/// Refers to the context's grids, media and lights. Without cells for a medium that does not fly in lanes.
LaneScene lane_scene(const PathContext& context, size_t medium, WorldPaths& world);

}  // namespace brume
