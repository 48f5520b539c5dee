#pragma once
#include <array>
#include <functional>
#include <vector>

#include "base/progress.h"
#include "render/guides/ambient_light.h"
#include "render/guides/guide_media.h"
#include "render/guides/probe_grid.h"
#include "render/world/surfaces.h"

namespace brume {

/// Light that comes off surfaces, as the media meet it: mean radiance and flux of every colour on a coarse grid of
/// probes in the box around the media, from rays in fixed directions.
class SurfaceLight {
 public:
  /// Radiance that a surface sends back along a ray that hit it.
  using Reflected = std::function<dvec3(const Ray& ray, const SurfaceHit& hit)>;

  SurfaceLight(const GuideMedia& media, const Surfaces& surfaces, const Reflected& reflected,
               const AmbientLight& ambient_light, const Task& task);

  /// Of mean 1; black where no surface sends any light.
  dvec3 colour() const { return colour_; }
  /// Moments of the light on its way at a point, in a colour: mean radiance, mean flux.
  std::array<double, 4> at(const dvec3& world, GuideColour colour) const;
  /// Mean radiance over the hemisphere of a normal, by the cosine: what a diffuse surface of albedo 1 reflects. RGB.
  dvec3 onto(const dvec3& world, const dvec3& normal) const;

 private:
  struct Probe {
    dvec3 light[4]{};  ///< RGB of each moment
    AmbientCube cube;
  };

  ProbeGrid grid_;
  std::vector<Probe> probes_;
  dvec3 colour_{0};
};

}  // namespace brume
