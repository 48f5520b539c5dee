#pragma once
#include "render/guides/light_fields.h"

namespace brume {

/// What lights a surface in a scene of media, so far as it is solved.
struct Surroundings {
  const Lattice& lattice;
  double scale;  ///< what the forward peak leaves of the extinction
  const Lights& lights;
  const Surfaces& surfaces;
  GuideColour colour;
  const AmbientLight* ambient_light;  ///< null until it is gathered
  const SurfaceLight* surface_light;  ///< the same
};

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
  Lit passed;           ///< shares through the media and past surfaces; indirect: scattered by forward peaks alone
};
Beam beam_at(const SolvedLight& group, const Surroundings& around, const dvec3& p);

/// What a diffuse surface of albedo 1 reflects of a group's light at a point in front of it: lit through the media,
/// with shadows of surfaces.
Lit diffuse_light(const SolvedLight& group, const Surroundings& around, const dvec3& p, const dvec3& normal);

/// Radiance that a surface sends back along a ray that hit it, of all groups; metals show highlights of suns and lamps,
/// and of the sky what they mirror.
dvec3 reflected_light(const std::vector<SolvedLight>& groups, const Surroundings& around, const Ray& ray,
                      const SurfaceHit& hit);

}  // namespace brume
