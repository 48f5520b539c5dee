#pragma once
#include <algorithm>
#include <array>

#include "base/vec.h"

namespace brume {

/// What a rough dielectric coat reflects of light from a direction, by single scattering at its facets: E, tabulated.
class CoatAlbedo {
 public:
  /// @param alpha  GGX, above 0
  CoatAlbedo(double alpha, double ior);
  double at(double cos_theta) const;
  /// Over the hemisphere, weighted by the cosine.
  double mean() const { return mean_; }

 private:
  std::array<double, 65> values_;  // at cosines of (i / 64)^2, with straight lines between
  double mean_ = 0;
};

/// How a surface scatters. Local frame: z is the normal on the side of `wo`; both directions leave the surface.
struct Bsdf {
  enum class Kind { kDiffuse, kConductor, kDielectric, kCoated } kind = Kind::kDiffuse;
  dvec3 albedo{0.5};     ///< diffuse: reflectance; conductor: reflectance at normal incidence; dielectric: tint
  double roughness = 0;  ///< GGX alpha = roughness^2; 0 is a perfect mirror or clear glass
  double ior = 1.5;      ///< dielectric, coat: inside over outside
  dvec3 edge{1};         ///< conductor: reflectance at grazing incidence; dielectric, coat: tint of what is reflected
  const CoatAlbedo* coat = nullptr;  ///< coated
  dvec3 passed{0};                   ///< diffuse: transmittance, of light that leaves on the other side

  /// Perfectly specular: no light sampling can meet it.
  bool delta() const { return kind != Kind::kDiffuse && alpha() == 0; }
  /// Below 1e-3 the lobe is narrower than a pixel of any camera.
  double alpha() const {
    if (kind == Kind::kCoated) return std::max(roughness * roughness, kLeastCoat);
    return roughness * roughness < 1e-3 ? 0.0 : roughness * roughness;
  }
  static constexpr double kLeastCoat = 1e-3;  ///< alpha of a smooth coat: light sampling meets what is below

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

  /// Of a coated surface: a diffuse one as bright as its base seen from a direction, what its coat reflects as a
  /// conductor, and a diffuse one that reflects as much as both, of light from all around.
  Bsdf base_seen(double cos_o) const;
  Bsdf gloss() const;
  Bsdf evened() const;

 private:
  double base_share(double cos_o, double cos_i) const;
  double coat_chance(double cos_o) const;
  bool weigh(const dvec3& wo, Sample& out) const;
  double reflection_chance() const;
};

/// Unpolarised Fresnel reflectance. @param cos_i of the incident side, >= 0; @param eta transmitted over incident index
double fresnel_dielectric(double cos_i, double eta);

}  // namespace brume
