#pragma once
#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "base/vec.h"

namespace brume {

/// Henyey-Greenstein phase function; g in (-1, 1), positive forward. cos_theta lies between the propagation directions
/// before and after the event: +1 goes straight on. Normalised to 1 over the sphere, so its value is its own sampling
/// density.
/// Source: Henyey, Greenstein 1941; the stable forms are derived in docs/estimators.md.
struct HenyeyGreenstein {
  double g = 0;

  /// [1/sr]. Nothing cancels: the denominator is a sum of two non-negative terms.
  double value(double cos_theta) const {
    const double a = std::abs(g), one_minus = 1.0 - a;
    const double d = one_minus * one_minus + 2.0 * a * (1.0 - (g < 0 ? -cos_theta : cos_theta));
    return (1.0 - g * g) / (4.0 * kPi * d * std::sqrt(d));
  }

  /// Cosine of the scattering angle whose cumulative probability is xi.
  double sample_cosine(double xi) const {
    const double s = 2.0 * xi - 1.0;
    double c;
    if (std::abs(g) < 0.5) {
      // The textbook form times out its division by g: exact, isotropic at g = 0 without a branch.
      const double d = 1.0 + g * s;
      c = (s + g * (1.5 + 0.5 * s * s) + g * g * s + 0.5 * g * g * g * (s * s - 1.0)) / (d * d);
    } else {
      const double t = (1.0 - g * g) / (1.0 + g * s);
      c = (1.0 + g * g - t * t) / (2.0 * g);
    }
    return std::clamp(c, -1.0, 1.0);
  }

  /// A direction after the event, unit length; `d` is the direction before it.
  dvec3 sample(const dvec3& d, const dvec2& xi) const {
    const double c = sample_cosine(xi.x), s = std::sqrt(std::max(0.0, (1.0 - c) * (1.0 + c)));
    const SinCos phi = portable_sincos_2pi(xi.y);
    return glm::normalize(Frame(d).to_world({s * phi.cos, s * phi.sin, c}));
  }
};

}  // namespace brume
