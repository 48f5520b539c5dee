#pragma once
#include "render/guides/light_fields.h"
#include "render/world/bsdf.h"

namespace brume {

/// Radiance by the events that it comes from: the reflection alone, or scattering before it.
struct Lit {
  dvec3 direct{0}, indirect{0};
  void add(const dvec3& factor, const Lit& other) {
    direct += factor * other.direct;
    indirect += factor * other.indirect;
  }
};

/// Light of a sun or lamp that arrives at a point.
struct Beam {
  dvec3 towards{0};
  dvec3 irradiance{0};  ///< across `towards`, in empty space
  Lit transmitted;      ///< shares through the media and past surfaces; indirect: scattered by forward peaks alone
};

inline dvec3 in_frame(const Frame& frame, const dvec3& d) {
  return {glm::dot(d, frame.x), glm::dot(d, frame.y), glm::dot(d, frame.z)};
}

/// A point of a surface as its shading sees it.
struct ShadedPoint {
  ShadedPoint(const Surfaces& surfaces, const Ray& ray, const SurfaceHit& hit);

  dvec3 on, p;       ///< on the surface, and a margin in front of it
  dvec3 normal, wo;  ///< the normal lies on the side of wo, which points back along the ray
  bool inside;       ///< of the solid
  Bsdf bsdf;
  Frame frame;
  dvec3 to_frame(const dvec3& d) const { return in_frame(frame, d); }
  bool diffuse() const { return bsdf.kind == Bsdf::Kind::kDiffuse; }
};

/// What lights surfaces in a scene of media, so far as it is solved, and what they reflect of it.
struct LitSurfaces {
  const std::vector<SolvedLight>& groups;
  const Lattice& lattice;
  double scale;  ///< what the forward peak leaves of the extinction
  const Lights& lights;
  const Surfaces* surfaces;
  GuideColour colour;
  const AmbientLight* ambient_light;  ///< null until it is gathered
  const SurfaceLight* surface_light;  ///< the same

  /// Light of a group that a surface reflects once, lit through the media, with shadows of surfaces.
  Lit light_on(const ShadedPoint& at, const SolvedLight& group) const;
  /// What a diffuse surface reflects of all light that was scattered before it arrives from any direction.
  dvec3 indirect_light_on(const ShadedPoint& at) const;
  /// Radiance that a surface sends back along a ray that hit it, of all groups; metals show highlights of suns and
  /// lamps, and of the sky what they mirror.
  dvec3 reflected(const Ray& ray, const SurfaceHit& hit) const;

 private:
  Lit onto_diffuse(const SolvedLight& group, const dvec3& p, const dvec3& normal) const;
  Beam beam(const SolvedLight& group, const dvec3& p) const;
  Beam beam(const Light& source, const LocalLight& light, double depth, const dvec3& p) const;
  dvec3 unshadowed(const Light& light, const LocalLight& middle, const dvec3& p) const;
};

}  // namespace brume
