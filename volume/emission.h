#pragma once
#include <bit>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "volume/medium.h"

namespace brume {

/// Radiance of a black body in linear Rec. 709 [W/(m^2 sr nm), averaged over the visible weights], at a temperature in
/// kelvin; 0 below 500 K. Out-of-gamut negatives are clipped.
/// Source: Planck's law integrated against the CIE 1931 2-degree observer.
dvec3 blackbody(double kelvin);

/// Emission coefficient as a function of a grid's value: colours at given values, linear between and constant beyond,
/// or the emission of a black body.
///
/// The black body is tabulated by temperature with 2048 entries per octave from 500 K, the leading bits of the
/// temperature as a single-precision number, and linear between: within 1e-4 of blackbody() at every temperature,
/// whatever the grid's range (tests/render/emission_test.cpp).
class EmissionRamp {
 public:
  static constexpr float kColdest = 500.0f;  ///< [K] below it no emission is seen
  static constexpr uint32_t kColdestBits = 0x43fa0000u;
  static constexpr int kEntryBits = 12;  ///< of a temperature's bits, those that tell where it lies between entries
  static_assert(std::bit_cast<uint32_t>(kColdest) == kColdestBits);

  EmissionRamp() = default;
  /// Black-body emission of kelvin = offset + scale * value, up to `highest` (a grid value), times `intensity`; a value
  /// of 0 is no gas and emits nothing.
  /// @param planck  luminance 1 at 6500 K, and every other temperature in its visible proportion to that; otherwise
  ///                Blender's: luminance sigma T^4 1e-6 / pi in the black body's colour
  /// @param from_rec709  to the space that the colours are wanted in; none: they stay in Rec. 709
  static EmissionRamp of_blackbody(double offset, double scale, double highest, double intensity, bool planck,
                                   const std::optional<dmat3>& from_rec709 = {});
  /// @param stops  in increasing order of value, at least one
  static EmissionRamp of_colours(const std::vector<std::pair<double, dvec3>>& stops, double intensity);

  dvec3 operator()(double value) const;

  bool is_blackbody() const { return stops_.empty(); }
  double offset() const { return offset_; }                       ///< of a black body [K]
  double scale() const { return scale_; }                         ///< of a black body [K per value]
  const std::vector<double>& stops() const { return stops_; }     ///< at least two; empty for a black body
  const std::vector<dvec3>& entries() const { return entries_; }  ///< of the stops, or the table

 private:
  double offset_ = 0, scale_ = 1;
  std::vector<double> stops_;
  std::vector<dvec3> entries_;
};

/// One point of a flight, drawn in proportion to what it emits: for where the emission of each point has its own
/// weight. The sum of the weighted parts that were offered has the expectation weight(t) * value().
class EmittingPoint {
 public:
  /// @param part  of the integral, at the ray parameter t
  void offer(double t, const dvec3& part, Rng& rng) {
    const double size = (part.x + part.y + part.z) / 3;
    if (!(size > 0)) return;
    total_ += size;
    if (!(rng.uniform() * total_ < size)) return;
    source_ = source;
    t_ = t;
    colour_ = part / size;
  }
  size_t source = 0;  ///< whose parts are offered, to be set by the caller
  bool any() const { return total_ > 0; }
  size_t chosen_source() const { return source_; }
  double t() const { return t_; }
  dvec3 value() const { return colour_ * total_; }

 private:
  double t_ = 0, total_ = 0;
  dvec3 colour_{0};
  size_t source_ = 0;
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
  /// look-up in each stratum of at most `stride` voxels. Where t_max is a free flight's end, its expectation is the
  /// emitted radiance, transmittance included, because the flight passes t with the probability T(t). Proof:
  /// tests/render/emission_test.cpp
  /// @param time  in [0, 1] of the shutter
  dvec3 integrate(const Ray& world, double t_min, double t_max, double stride, double time, Rng& rng) const;
  /// Offers the look-ups of that integral to a point.
  void offer(const Ray& world, double t_min, double t_max, double stride, double time, Rng& rng,
             EmittingPoint& point) const;
  /// The part of a ray in a homogeneous shape; empty (first > second) where it misses it.
  std::pair<double, double> inside(const Ray& world, double t_min, double t_max, double time) const;
  /// The coefficient of a homogeneous shape.
  const dvec3& coefficient() const { return coefficient_; }
  /// The coefficient at a world point, of a field that does not move.
  dvec3 coefficient(const dvec3& world) const {
    const dvec3 local = shape_.to_local(world);
    if (shape_.homogeneous()) return shape_.homogeneous()->contains(local) ? coefficient_ : dvec3(0);
    return ramp_(shape_.density(local));
  }
  /// The field as it is at a time in [0, 1] of the shutter.
  EmissionField at_time(double time) const;
  bool moves() const { return shape_.moves(); }
  const Medium& shape() const { return shape_; }
  const EmissionRamp& ramp() const { return ramp_; }
  /// Encloses everything that emits, world space.
  Medium::Sphere bounding_sphere() const { return shape_.bounding_sphere(); }

 private:
  template <class Visit>
  void visit(const Ray& world, double t_min, double t_max, double stride, double time, Rng& rng, Visit&& visitor) const;

  Medium shape_;
  dvec3 coefficient_{0};  // of a homogeneous shape
  EmissionRamp ramp_;
};

}  // namespace brume
