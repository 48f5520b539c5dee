#pragma once
#include "render/transport/integrator.h"

namespace brume {

// What paths record besides light: layers that guide filters. Each is an expectation over the pixel's paths.

inline constexpr double kDeepest = 50;  ///< where the layer optical_depth is clamped
/// Points on a camera ray, one in each quarter of the distribution of first scatterings, for the weighted gradient.
inline constexpr size_t kMarchedPoints = 4;

/// Coverage and gradient of a camera ray that hits a medium's isosurface at t. @param local  in the medium's
/// coordinates
void record_isosurface(const Medium& medium, const Ray& local, double t, PathSample& sample);

/// Layers that follow from the camera ray alone: the medium's isosurface, optical depth, the marched gradient.
void record_camera_ray(const PathContext& context, std::span<const Medium> media, const Ray& ray, Rng rng,
                       PathSample& sample);

/// Layers of a path's first event, where that is a scattering at p after flying along d.
/// @param weight  of the path before the event
/// @return        the flash lamp's part of the flash image, without its intensity; 0 where the image is not recorded
dvec3 record_first_scatter(const PathContext& context, std::span<const Medium> media, const Medium& medium,
                           const dvec3& eye, const dvec3& p, const dvec3& d, const dvec3& weight, const dvec3& albedo,
                           PathSample& sample);

}  // namespace brume
