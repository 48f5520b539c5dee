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

  double lowest() const { return lowest_; }                       ///< value of the first entry
  double scale() const { return scale_; }                         ///< entries per value
  const std::vector<dvec3>& entries() const { return entries_; }  ///< at least two

 private:
  double lowest_ = 0, scale_ = 1;
  std::vector<dvec3> entries_{dvec3(0), dvec3(0)};
};

/// A field that emits: coefficient [radiance per world unit] = ramp(value), independent of extinction, so that flames
/// without smoke shine. Its shape may move over the shutter as a medium's does.
class EmissionField {
 public:
  /// @param shape  where the values are and how they move; its extinction does not matter
  EmissionField(Medium shape, EmissionRamp ramp) : shape_(std::move(shape)), ramp_(std::move(ramp)) {}
  /// The same coefficient everywhere inside a homogeneous shape.
  EmissionField(Medium shape, const dvec3& coefficient) : shape_(std::move(shape)), coefficient_(coefficient) {}

  /// Unbiased estimate of the emission coefficient's integral along a world ray from t_min to t_max: one jittered
  /// look-up in each stretch of at most `stride` voxels. Where t_max is a free flight's end, its expectation is the
  /// emitted radiance, transmittance included, because the flight passes t with the probability T(t). Proof:
  /// tests/render/media_test.cpp
  /// @param time  in [0, 1] of the shutter
  dvec3 integrate(const Ray& world, double t_min, double t_max, double stride, double time, Rng& rng) const;
  bool moves() const { return shape_.moves(); }
  const Medium& shape() const { return shape_; }
  const EmissionRamp& ramp() const { return ramp_; }
  /// Encloses what glows, world space.
  Medium::Sphere bounding_sphere() const { return shape_.bounding_sphere(); }

 private:
  dvec3 integrate(const Medium& shape, const Ray& world, double t_min, double t_max, double stride, Rng& rng) const;

  Medium shape_;
  dvec3 coefficient_{0};  // of a homogeneous shape
  EmissionRamp ramp_;
};

}  // namespace brume
