#pragma once
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "base/math.h"
#include "base/vec.h"
#include "volume/fournier_forand.h"

namespace brume {

#include "volume/henyey_greenstein.h"

/// Henyey-Greenstein phase function; g in (-1, 1), positive forward. cos_theta lies between the propagation directions
/// before and after the event: +1 goes straight on. Normalised to 1 over the sphere, so its value is its own sampling
/// density. A negative g is the positive one turned around.
/// Source: Henyey, Greenstein 1941.
struct HenyeyGreenstein {
  double g = 0;

  /// [1/sr]
  double value(double cos_theta) const { return henyey_greenstein(std::abs(g), 1 - (g < 0 ? -cos_theta : cos_theta)); }

  /// Cosine of the scattering angle whose cumulative probability is xi.
  double sample_cosine(double xi) const {
    const double c = std::max(-1.0, 1 - sample_henyey_greenstein(std::abs(g), g < 0 ? 1 - xi : xi));
    return g < 0 ? -c : c;
  }
};

/// Draine's phase function, Henyey-Greenstein times 1 + alpha cos^2: normalised, g in (0, 1), alpha >= 0.
/// Source: Draine 2003, Scattering by Interstellar Dust Grains, eq. 4-6.
struct Draine {
  double g = 0, alpha = 0;

  double value(double cos_theta) const {
    return HenyeyGreenstein{g}.value(cos_theta) * (1.0 + alpha * cos_theta * cos_theta) / norm();
  }
  /// By Newton's method on the closed form of the distribution, held inside a shrinking bracket.
  double sample_cosine(double xi) const;
  /// Probability of a cosine below c.
  double cumulative(double c) const;

 private:
  double norm() const { return 1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0; }
};

/// What a medium does with a direction: a mixture of up to two lobes, each normalised; the mixture is its own sampling
/// density. The second lobe exists where its weight is above 0; `ocean` stands in its place, alone.
struct PhaseFunction {
  HenyeyGreenstein first;
  Draine second;
  double second_weight = 0;
  std::shared_ptr<const FournierForand> ocean = nullptr;

  static PhaseFunction henyey_greenstein(double g) { return {{g}, {}, 0.0}; }
  static PhaseFunction two_lobes(double g, double g2, double second_weight) { return {{g}, {g2, 0}, second_weight}; }
  /// Dust grains; g = 0 and alpha = 1 is Rayleigh's.
  static PhaseFunction draine(double g, double alpha) { return {{}, {g, alpha}, 1.0}; }
  /// Water droplets of one diameter in micrometres, 5 .. 50: a forward spike and a body.
  /// Source: Jendersie, d'Eon 2023, An Approximate Mie Scattering Function for Fog and Cloud Rendering, eq. 4-7.
  static PhaseFunction mie(double droplet_diameter);

  /// Particles in water. @param index, slope  as FournierForand takes them
  static PhaseFunction fournier_forand(double index, double slope) {
    return {{}, {}, 1.0, std::make_shared<const FournierForand>(index, slope)};
  }

  bool is_henyey_greenstein() const { return second_weight == 0; }
  bool isotropic() const { return is_henyey_greenstein() && first.g == 0; }
  /// [1/sr]
  double value(double cos_theta) const {
    if (ocean) return ocean->value(cos_theta);
    const double a = first.value(cos_theta);
    return second_weight == 0 ? a : a + second_weight * (second.value(cos_theta) - a);
  }
  double sample_cosine(double xi) const {
    if (second_weight == 0) return first.sample_cosine(xi);
    if (ocean) return ocean->sample_cosine(xi);
    // The lobe is chosen by the same number, stretched back to the whole interval.
    if (xi < second_weight) return second.sample_cosine(xi / second_weight);
    return first.sample_cosine((xi - second_weight) / (1.0 - second_weight));
  }
  /// A direction after the event, unit length; `d` is the direction before it.
  dvec3 sample(const dvec3& d, const dvec2& xi) const {
    const double c = sample_cosine(xi.x), s = std::sqrt(std::max(0.0, (1.0 - c) * (1.0 + c)));
    const SinCos phi = portable_sincos_2pi(xi.y);
    return glm::normalize(Frame(d).to_world({s * phi.cos, s * phi.sin, c}));
  }
};

}  // namespace brume
