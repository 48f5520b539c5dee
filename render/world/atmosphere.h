#pragma once
#include <array>
#include <vector>

#include "base/progress.h"
#include "base/vec.h"

namespace brume {

/// Air, aerosol and ozone around a round planet, at the wavelengths 680, 550 and 440 nm that stand for red, green and
/// blue. Lengths in metres, the planet's centre is the origin.
///
/// Sources: Bruneton, Neyret 2008 and Hillaire 2020 for Rayleigh's coefficients, the scale heights and the ozone;
/// Preetham, Shirley, Smits 1999 for turbidity and the aerosol's power of the wavelength.
struct Atmosphere {
  static constexpr double kGround = 6360e3, kTop = 6460e3;
  static constexpr double kAirScale = 8000, kAerosolScale = 1200;
  static constexpr double kOzoneMiddle = 25e3, kOzoneHalfWidth = 15e3;

  dvec3 air{5.802e-6, 13.558e-6, 33.1e-6};  ///< scattering at the ground [1/m], phase function Rayleigh's
  dvec3 aerosol{0};                         ///< extinction at the ground [1/m]
  double aerosol_albedo = 0.92, aerosol_g = 0.76;
  dvec3 ozone{0.650e-6, 1.881e-6, 0.085e-6};  ///< absorption in the middle of its layer [1/m]
  double ground_albedo = 0.2;

  /// @param turbidity  optical depth of air and aerosol over that of air, at 550 nm from the ground upwards
  Atmosphere(double turbidity, double ground_albedo);

  /// Densities relative to those that the coefficients are of: air, aerosol, ozone.
  static dvec3 densities(double height);
  /// Of these densities or of their integrals along a ray.
  dvec3 extinction(const dvec3& amounts) const { return air * amounts.x + aerosol * amounts.y + ozone * amounts.z; }
};

/// The light in an atmosphere under a sun of irradiance 1, which is far away and small: solved once, order by order,
/// near the place from which it is looked at.
///
/// What is scattered is tabulated by height, the sun's height and direction; rays are marched through these tables. The
/// light scattered once is exact at each point of a ray. Within 3 % of a path tracer of the same atmosphere
/// (tests/render/atmosphere_test.cpp).
class AtmosphereLight {
 public:
  /// @param sun_sine  of the angle from the horizon to the sun, at the place that is looked from
  AtmosphereLight(const Atmosphere& atmosphere, double sun_sine, const Task& task = {});

  /// Radiance of what lies ahead of a point inside: air, and the ground where the ray meets it; not the sun's disc.
  /// @param sun  towards it
  dvec3 radiance(const dvec3& p, const dvec3& d, const dvec3& sun) const;
  /// From a point towards a direction that leaves the atmosphere; 0 where the ground is in the way.
  dvec3 transmittance(const dvec3& p, const dvec3& d) const;
  const Atmosphere& atmosphere() const { return atmosphere_; }

 private:
  static constexpr int kHeights = 14, kElevations = 20, kAzimuths = 14, kDirections = kElevations * kAzimuths;
  struct Place;                      // in the tables
  struct Directions;                 // of the tables
  struct Ahead;                      // of a ray
  struct Arriving;                   // at a place
  using Mean = std::array<vec3, 2>;  // radiance times phase function over all directions: Rayleigh's, the aerosol's

  size_t index(int height, int sun) const {
    return static_cast<size_t>(height) * suns_.size() + static_cast<size_t>(sun);
  }
  void make_columns();
  dvec3 column(double r, double cosine) const;
  Place place(double r, double sun_sine) const;
  Mean scattered(const Place& place, double cosine, double cos_azimuth) const;
  dvec3 ground_irradiance(const Place& place, const std::vector<vec3>& of) const;
  Mean scattered(const dvec3& p, const dvec3& d, const dvec3& sun) const;
  template <class Source>
  Ahead march(const dvec3& p, const dvec3& d, double coarseness, const Source& source) const;
  dvec3 ground_radiance(const Ahead& ahead, const dvec3& sun, const std::vector<vec3>& irradiance) const;
  Arriving arriving(bool first, int height, double angle, const Directions& directions,
                    const std::vector<vec3>& lit) const;
  void solve(const Task& task);

  Atmosphere atmosphere_;
  std::vector<double> suns_;      // angles from the horizon to the sun
  std::vector<vec3> columns_;     // logarithms of the integrals of the densities towards space
  std::vector<Mean> scattered_;   // by height, sun and direction: of all orders but the first, fourth roots
  std::vector<vec3> irradiance_;  // of the ground by sun: direct and diffuse
};

}  // namespace brume
