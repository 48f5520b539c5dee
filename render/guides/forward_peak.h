#pragma once
#include <algorithm>
#include <array>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "volume/phase_function.h"

namespace brume {

/// Share of scattering by a Henyey-Greenstein phase function that counts as straight on. The square of the mean cosine
/// keeps the second moment; where the peak is broad (g below 0.7) that would keep together what spreads, and there is
/// less of it.
inline constexpr double kNarrowPeak = 0.7;
inline double peak_weight(double g) {
  if (!(g > 0)) return 0;
  const double share = std::min(1.0, g / kNarrowPeak);
  return g * g * share * share * share * share;
}

/// Light that turns towards the eye at one place and is scattered nearly straight on any number of times before or
/// behind it.
///
/// A Henyey-Greenstein phase function of Legendre moments g^l is split into a peak of weight g^2 with moments 1, 1, 1,
/// g, g^2, ... and a rest that is linear in the cosine. The turn is one scattering by the rest among n + 1, or all n +
/// 1 lie in the peak and any of them may be called the turn:
///
///     p_n = [1 - g^2 + 3 g (1 - g) cos] / 4 pi
///           + g^2 / (n + 1) { (1 + 3 cos) / 4 pi + g^(-2 n - 2) [HG(g^(n + 1), cos) - (1 + 3 g^(n + 1) cos) / 4 pi] }
///
/// p_0 is the phase function itself. Sources for the peak: Joseph, Wiscombe, Weinman 1976; for light that is scattered
/// by the exact function where the peak counts as not scattered: Nakajima, Tanaka 1988.
class ForwardPeak {
 public:
  static constexpr double kDeepest = 600;  ///< greater depths count as this one, whose exponential is finite

  ForwardPeak() = default;
  ForwardPeak(double g, double cosine) {
    if (!(g > 0)) return;
    const double f = peak_weight(g);
    constexpr double kEven = 1 / (4 * kPi);
    double power = g, factor = 1 / (g * g), count = 1;
    std::array<double, kTerms> phase;  // p_1, p_2, ...
    for (double& p : phase) {
      power *= g;
      factor /= g * g;
      count += 1;
      // Where the difference would be rounding, its first term.
      const double narrow = power < 0.02
                                ? 5 * (1.5 * cosine * cosine - 0.5) * kEven
                                : factor * (HenyeyGreenstein{power}.value(cosine) - (1 + 3 * power * cosine) * kEven);
      p = (1 - f + 3 * (g - f) * cosine) * kEven + f / count * ((1 + 3 * cosine) * kEven + narrow);
    }
    last_ = phase.back();
    double factorial = 1;
    for (size_t n = 1; n < kTerms; ++n) {
      factorial *= static_cast<double>(n);
      more_[n - 1] = (phase[n - 1] - last_) / factorial;
    }
  }
  /// Sum over n >= 1 of depth^n / n! p_n: what light has that is scattered so often, where light that is scattered once
  /// has p_0. From n = 8 on all p_n have the shape of the last: p_8 (exp(depth) - 1) and a polynomial.
  /// @param depth  mean number of scatterings in the peak
  double repeated(double depth) const {
    const double d = std::min(depth, kDeepest);
    double sum = 0;
    for (size_t n = kTerms - 1; n-- > 0;) sum = d * (more_[n] + sum);
    // The split is exact in the first moments alone: it may leave a little less than nothing to the side.
    return std::max(0.0, sum + last_ * (1 / attenuation(d) - 1));
  }
  /// (p_1 - p_8) / 1!, ..., (p_7 - p_8) / 7!, p_8.
  std::array<double, 8> coefficients() const {
    std::array<double, kTerms> all;
    std::copy(more_.begin(), more_.end(), all.begin());
    all.back() = last_;
    return all;
  }

 private:
  static constexpr size_t kTerms = 8;
  std::array<double, kTerms - 1> more_{};  // (p_n - p_8) / n!
  double last_ = 0;                        // p_8
};

}  // namespace brume
