#pragma once
#include <functional>
#include <vector>

#include "base/progress.h"
#include "render/guides/guide_media.h"
#include "render/guides/lattice.h"
#include "render/guides/scattering_solver.h"
#include "render/world/surfaces.h"

namespace brume {

/// Light that comes off surfaces, as the media meet it: mean radiance and flux of every colour on a coarse grid of
/// probes in the box around the media, from rays in fixed directions.
class SurfaceLight {
 public:
  /// Radiance that a surface sends back along a ray that hit it.
  using Reflected = std::function<dvec3(const Ray& ray, const SurfaceHit& hit)>;
  /// Transmittance of the media from a point along a direction, so far [world units].
  using Transmittance = std::function<double(const dvec3& from, const dvec3& towards, double distance)>;

  SurfaceLight(const GuideMedia& media, const Surfaces& surfaces, const Reflected& reflected,
               const Transmittance& transmittance, const Task& task);

  /// Of mean 1; black where no surface sends any light.
  dvec3 colour() const { return colour_; }
  /// Moments of the light on its way at a point, in a colour: mean radiance, mean flux.
  std::array<double, 4> at(const dvec3& world, GuideColour colour) const;
  /// Mean radiance over the hemisphere of a normal, by the cosine: what a diffuse surface of albedo 1 reflects. RGB.
  dvec3 onto(const dvec3& world, const dvec3& normal) const;

 private:
  struct Probe {
    dvec3 light[4]{};  ///< RGB of each moment
  };
  const Probe& probe(const ivec3& p) const { return probes_[static_cast<size_t>((p.x * n_.y + p.y) * n_.z + p.z)]; }
  /// Linear between the probes, as beyond the outermost ones. @param weight  of each probe around
  template <class Weight>
  Probe between(const dvec3& world, const Weight& weight) const;

  dvec3 lo_{0}, spacing_{1};
  ivec3 n_{1};
  std::vector<Probe> probes_;
  dvec3 colour_{0};
};

}  // namespace brume
