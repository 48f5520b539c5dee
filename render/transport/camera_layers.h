#pragma once
#include <array>

#include "render/transport/lane_scene.h"
#include "render/transport/path_layers.h"
#include "render/transport/path_states.h"

// What camera rays record besides light: the medium's isosurface, the gradient there, optical depth.

namespace brume {

/// Points whose density gradient is wanted.
struct GradientPoints {
  Column3 p;         ///< local coordinates of the bricks
  Column3 gradient;  ///< its direction, world space; 0 where it is too small to tell
  SlotList slots;    ///< whose they are
};

/// Results of the camera rays' marches for the layers, by slot.
struct CameraRayLayers {
  Column<float> begin;                              ///< ray parameter from which the surface is searched
  Column<float> covered;                            ///< 1 where the ray hits the surface
  Column3 gradient;                                 ///< its direction there, world space
  Column<float> depth;                              ///< optical depth, clamped at 50
  std::array<Column<float>, kMarchedPoints> point;  ///< ray parameters, -1 past the end
};

/// Brackets of the rays' intersections with the medium's isosurface: two ray parameters, outside and inside.
struct IsosurfaceCrossings {
  Column<float> outside, inside;
  Column<float> below, above;  ///< the densities there; negative where unknown
  SlotList slots;
  SlotList unsure;  ///< rays for which no sample was inside, but that passed close enough to have crossed the surface

  void add(size_t slot, float t_outside, float t_inside, float density_below, float density_above) {
    const size_t k = slots.count;
    outside[k] = t_outside;
    inside[k] = t_inside;
    below[k] = density_below;
    above[k] = density_above;
    slots.push(slot);
  }
};

/// Finds where the density along each ray first reaches `isosurface_density`, sampled once per voxel length from
/// `begin` on, and adds the bracket to the crossings.
void lanes_find_isosurface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                           const CameraRayLayers& camera, IsosurfaceCrossings& crossings);

/// The same for a displaced grid, sampled four times per voxel length, from 0 on.
void lanes_find_displaced_isosurface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                                     IsosurfaceCrossings& crossings);

/// The points half a voxel behind the surface, where central differences see the medium on both sides.
void lanes_isosurface_points(const LaneScene& scene, const PathStates& paths, IsosurfaceCrossings& crossings,
                             GradientPoints& points);

/// Optical depth of each ray from one look-up per voxel length, at an offset drawn for the ray, of one voxel by its
/// trilinear weight: without bias. The points lie where exp(-optical depth) passes a random level in each quarter of
/// [0, 1]. Draws from a copy of the path's generator.
void lanes_march(const LaneScene& scene, const PathStates& paths, const SlotList& rays, CameraRayLayers& camera);

/// Central differences of the interpolated density, as volume/gradient.h, at the paths' times.
void lanes_gradient(const LaneScene& scene, const PathStates& paths, GradientPoints& points);

}  // namespace brume
