#pragma once
#include <array>

namespace brume {

/// Phase function of particles in water whose sizes follow a power law: a forward peak without a bound, which grows
/// towards the axis as a power of the angle, and a flat backward part. Normalised; cosines as in HenyeyGreenstein.
/// Source: Fournier, Forand 1994; the form and its integral as in Fournier, Jonasz 1999, Computer-based underwater
/// imaging analysis.  Proof: tests/volume/fournier_forand_test.cpp
class FournierForand {
 public:
  /// @param index  of refraction of the particles relative to the water, above 1
  /// @param slope  mu of the sizes' distribution, 3 < mu < 5
  FournierForand(double index, double slope);

  /// [1/sr]; at the axis itself the value at an angle of 1e-7.
  double value(double cos_theta) const;
  /// Cosine whose cumulative probability is xi: the distribution is closed, and is inverted by Newton's method from a
  /// table, held inside a shrinking bracket.
  double sample_cosine(double xi) const;
  /// Probability of a cosine below c.
  double cumulative(double c) const { return 1 - within(0.5 * (1 - c)); }
  double mean_cosine() const { return mean_cosine_; }
  /// Share of light that turns back, by more than 90 degrees.
  double backscatter() const { return cumulative(0); }

 private:
  // s = sin^2(angle / 2) everywhere below.
  double within(double s) const;   // probability of a smaller one
  double density(double s) const;  // [1/sr]

  static constexpr int kCells = 128;
  double nu_, scale_, correction_;  // delta = scale * s; of the cosine polynomial that makes up for the approximation
  double mean_cosine_;
  std::array<double, kCells + 1> table_{};  // within(), evenly in log s
};

}  // namespace brume
