#pragma once
#include <vector>

#include "base/progress.h"
#include "volume/medium.h"

namespace brume {

/// What is seen of a density by parallel rays along a view, once its extinction makes it neither black nor invisible.
/// Voxels too faint to be seen do not count however many they are, nor does what is too small to matter (single voxels
/// astray): a picture that is framed by this shows the volume as one would frame it by eye.
struct VisibleDensity {
  std::vector<dvec3> points;  ///< where the rays that see it enter and leave it, world space; empty: nothing is seen
  double typical_depth = 0;   ///< optical depth at an extinction of 1 per density, deeper than three quarters of it
};

/// @param medium  of a grid   @param view  unit, the rays' direction   @param up  in the picture
/// @param wanted_depth  what typical_depth becomes by the extinction that is chosen
VisibleDensity visible_density(const Medium& medium, const dvec3& view, const dvec3& up, double wanted_depth,
                               const Task& task);

}  // namespace brume
