#pragma once
#include <optional>

#include "render/transport/integrator.h"

namespace brume {

// What paths record besides light: layers that guide filters. Each is an expectation over the pixel's paths.

inline constexpr double kDeepest = 50;  ///< where the layer optical_depth is clamped
/// Points on a camera ray, one in each quarter of the distribution of first scatterings, for the weighted gradient.
inline constexpr size_t kMarchedPoints = 4;

/// The direction of the gradient half a voxel behind the point at t where a camera ray meets a medium's isosurface:
/// there the differences see the medium on both sides. @param local  in the medium's coordinates
std::optional<dvec3> isosurface_gradient(const Medium& medium, const Ray& local, double t);

/// Layers of a path's first event, where that is a scattering at p after flying along d.
/// @param weight  of the path before the event
/// @return        the flash lamp's part of the flash image, without its intensity; 0 where the image is not recorded
dvec3 record_first_scatter(const PathContext& context, std::span<const Medium> media, const Medium& medium,
                           const dvec3& eye, const dvec3& p, const dvec3& d, const dvec3& weight, const dvec3& albedo,
                           PathSample& sample);

}  // namespace brume
