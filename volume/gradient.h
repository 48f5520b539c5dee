#pragma once
#include <optional>

#include "volume/medium.h"

namespace brume {

/// Share of the maximum density, per voxel, below which a difference is not told from rounding.
inline constexpr double kLeastGradient = 1e-4;

/// World-space density gradient at a local point: central differences at the eight voxels around, interpolated
/// trilinearly (the gradient-kernel paper's gradients at grid centres, section 2.3). Where it vanishes against
/// `max density / voxel`, the stencil widens to 2 and 4 voxels; nothing where it still does, because a normalised
/// rounding error would be a direction of noise.
/// @return gradient [density / world unit], not normalised
std::optional<dvec3> density_gradient(const Medium& medium, const dvec3& local);

/// Where a ray meets the medium's isosurface: the first point at which the interpolated density reaches `iso`. Both are
/// of the density without detail, whose isosurface is one of scraps.
/// Exact for a still grid, up to rounding: between the faces of a voxel the density is a cubic along the ray, whose
/// first root is found. A field displaced by its velocity is looked at every quarter of a voxel.
/// @param ray    local coordinates
/// @param begin  ray parameter before which nothing is looked for
/// @return       the ray parameter; `begin` where the ray is inside there; nothing where the surface is never met
std::optional<double> find_isosurface(const Medium& medium, const Ray& ray, float iso, double begin = 0);

}  // namespace brume
