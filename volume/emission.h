#pragma once
#include <vector>

#include "base/rng.h"
#include "volume/medium.h"

namespace brume {

/// Radiance of a black body in linear Rec. 709 [W/(m^2 sr nm), averaged over the visible weights], at a temperature in
/// kelvin; 0 below 500 K. Out-of-gamut negatives are clipped.
/// Source: Planck's law integrated against the CIE 1931 observer (multi-lobe fit of Wyman, Sloan, Shirley 2013).
dvec3 blackbody(double kelvin);

/// Emission coefficient as a function of a grid's value: linear between equally spaced entries, the ends continued.
class EmissionRamp {
 public:
  EmissionRamp() = default;
  EmissionRamp(double lowest, double highest, std::vector<dvec3> entries)
      : lowest_(lowest),
        scale_(static_cast<double>(entries.size() - 1) / (highest - lowest)),
        entries_(std::move(entries)) {}

  /// Black-body glow of kelvin = offset + scale * value, up to `highest` (a grid value), times `intensity`.
  /// @param planck  luminance 1 at 6500 K, and every other temperature in its visible proportion to that; otherwise
  ///                Blender's: luminance sigma T^4 1e-6 / pi in the colour of the glow
  static EmissionRamp of_blackbody(double offset, double scale, double highest, double intensity, bool planck);
  /// Colours at given values, linear between.
  static EmissionRamp of_colours(const std::vector<std::pair<double, dvec3>>& stops, double intensity);

  dvec3 operator()(double value) const;

 private:
  double lowest_ = 0, scale_ = 1;
  std::vector<dvec3> entries_{dvec3(0), dvec3(0)};
};

/// A field that emits: coefficient [radiance per world unit] = ramp(value), independent of extinction, so that flames
/// without smoke shine. Fields are referred to, not owned.
class EmissionField {
 public:
  EmissionField(const BrickGrid& bricks, const Placement& placement, EmissionRamp ramp)
      : bricks_(&bricks), placement_(placement), ramp_(std::move(ramp)) {}
  /// The same coefficient everywhere inside a shape.
  EmissionField(const Solid& solid, const Placement& placement, const dvec3& coefficient)
      : solid_(solid), coefficient_(coefficient), placement_(placement) {}

  /// Unbiased estimate of the emission coefficient's integral along a world ray from t_min to t_max: one jittered
  /// look-up in each stretch of at most `stride` voxels. Where t_max is a free flight's end, its expectation is the
  /// emitted radiance, transmittance included, because the flight passes t with the probability T(t). Proof:
  /// tests/volume/emission_test.cpp
  dvec3 integrate(const Ray& world, double t_min, double t_max, double stride, Rng& rng) const;
  dvec3 coefficient(const dvec3& world) const;
  /// Encloses what glows, world space.
  Medium::Sphere bounding_sphere() const;

 private:
  const BrickGrid* bricks_ = nullptr;
  std::optional<Solid> solid_;
  dvec3 coefficient_{0};  // of the solid
  Placement placement_;
  EmissionRamp ramp_;
};

}  // namespace brume
