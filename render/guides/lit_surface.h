#pragma once
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "render/guides/ambient_light.h"
#include "render/guides/guide_light.h"
#include "render/guides/guide_media.h"
#include "render/guides/sharp_light.h"
#include "render/guides/surface_light.h"
#include "render/world/bsdf.h"

namespace brume {

/// A point of a surface as its shading sees it.
struct ShadedPoint {
  ShadedPoint(const Surfaces& surfaces, const Ray& ray, const SurfaceHit& hit);

  dvec3 on, p;       ///< on the surface, and a margin in front of it
  dvec3 normal, wo;  ///< the normal lies on the side of wo, which points back along the ray
  bool inside;       ///< of the solid
  Bsdf bsdf;
  Frame frame;
  dvec3 to_frame(const dvec3& d) const { return {glm::dot(d, frame.x), glm::dot(d, frame.y), glm::dot(d, frame.z)}; }
  /// Of a coated surface, whose bsdf is that of its base: what its coat mirrors.
  std::optional<Bsdf> gloss;
  /// Another way of scattering at the same point.
  ShadedPoint with(const Bsdf& other) const {
    ShadedPoint point = *this;
    point.bsdf = other;
    return point;
  }
  bool diffuse() const { return bsdf.kind == Bsdf::Kind::kDiffuse; }
};

/// What lights surfaces in a scene of media, so far as it is solved, and what they reflect of it.
struct LitSurfaces {
  const std::vector<std::unique_ptr<GuideLight>>& groups;
  const Lights& lights;  ///< all of the scene: solid ones throw shadows
  double scale;          ///< what the forward peak leaves of the extinction
  const SkyParts& sky;
  const Surfaces* surfaces;
  const AmbientLight* ambient_light;
  const SurfaceLight* surface_light;
  const GuideMedia* media = nullptr;  ///< looked up where their shadows fall; null: the nodes' extinction is enough
  GuideColour colour = kGrey;         ///< of the guides

  /// Light from all around that a diffuse surface of albedo 1 reflects; of any other none.
  /// @param of_groups  as SurfaceLight::onto
  SurfaceLight::Around around(const ShadedPoint& at, std::span<dvec3> of_groups = {}) const {
    return surface_light && at.diffuse() ? surface_light->onto(at.p, at.normal, of_groups) : SurfaceLight::Around();
  }
  /// Light of a group that a surface reflects once, lit through the media, with shadows of surfaces.
  Lit light_on(const ShadedPoint& at, const SurfaceLight::Around& around, const GuideLight& group) const;
  /// Radiance that a surface sends back along a ray that hit it, of all groups; metals show highlights of suns and
  /// lamps, and of the sky what they mirror.
  /// @param spread     of the facets that the ray stands for [rad]: a metal's lobe is as much wider
  /// @param of_groups  gets what of it is of each light group, or nothing
  dvec3 reflected(const Ray& ray, const SurfaceHit& hit, double spread = 0, std::span<dvec3> of_groups = {}) const;

  /// Shares of a light that arrive at a point through the media and past surfaces; indirect: scattered by forward peaks
  /// alone.
  Lit transmitted(const KnownLight& source, const ArrivingLight& light, const dvec3& p) const;
  /// What surfaces and the bodies of other lamps leave of a light.
  /// @param from  the light
  dvec3 open(const Ray& shadow, double distance, const Light& from) const;
  /// What the media alone leave, along a direction.
  Lit shares(const dvec3& p, const dvec3& towards, double distance) const;

 private:
  /// Optical depth through the media but for the forward peak.
  double depth(const dvec3& p, const dvec3& towards, double distance) const;
  /// What arrives of a light of known direction.
  ArrivingLight arriving(const SharpLight& light, const dvec3& p) const;
  dvec3 unshadowed(const KnownLight& source, const ArrivingLight& light, const dvec3& p) const;
};

}  // namespace brume
