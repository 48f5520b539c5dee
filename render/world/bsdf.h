#pragma once
#include "base/vec.h"

namespace brume {

/// How a surface scatters. Local frame: z is the normal on the side of `wo`; both directions leave the surface.
struct Bsdf {
  enum class Kind { kDiffuse, kConductor, kDielectric } kind = Kind::kDiffuse;
  dvec3 albedo{0.5};     ///< diffuse: reflectance; conductor: reflectance at normal incidence; dielectric: tint
  double roughness = 0;  ///< GGX alpha = roughness^2; 0 is a perfect mirror or clear glass
  double ior = 1.5;      ///< dielectric: inside over outside
  dvec3 edge{1};         ///< conductor: reflectance at grazing incidence; dielectric: tint of what is reflected

  /// Perfectly specular: no light sampling can meet it.
  bool delta() const { return kind != Kind::kDiffuse && alpha() == 0; }
  /// Below 1e-3 the lobe is narrower than a pixel of any camera.
  double alpha() const { return roughness * roughness < 1e-3 ? 0.0 : roughness * roughness; }

  /// f(wo, wi) |cos theta_i|, for non-delta surfaces. @param inside wo lies inside of the solid
  dvec3 value(const dvec3& wo, const dvec3& wi, bool inside) const;
  /// Solid-angle density of sample() for non-delta surfaces.
  double pdf(const dvec3& wo, const dvec3& wi, bool inside) const;

  struct Sample {
    dvec3 wi{0};
    dvec3 weight{0};  ///< f |cos| / pdf
    double pdf = 0;   ///< meaningless for delta surfaces
    bool transmitted = false;
  };
  /// False where the path ends: the sampled direction carries nothing. @param u three numbers in [0, 1)
  bool sample(const dvec3& wo, bool inside, const dvec3& u, Sample& out) const;
};

/// Unpolarised Fresnel reflectance. @param cos_i of the incident side, >= 0; @param eta transmitted over incident index
double fresnel_dielectric(double cos_i, double eta);

}  // namespace brume
