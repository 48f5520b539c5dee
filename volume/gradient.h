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

/// Where a ray meets the medium's surface: the first point at which the density reaches `iso`.
/// Deterministic: marched in voxels through the cells whose bound allows it, then bisected.
/// @param ray  local coordinates, parametrised by world distance
/// @return     the ray parameter; 0 where the ray starts inside; nothing where the surface is never met
std::optional<double> find_surface(const Medium& medium, const Ray& ray, float iso);

}  // namespace brume
