#include "volume/phase_function.h"

namespace brume {

// With d = 1 + g^2 - 2 g u, the integrals of d^(-3/2) and u^2 d^(-3/2) over u are closed; below |g| = 0.02 they cancel,
// and the first two terms of the series in g take their place (error below 1e-5 of the distribution at that g).
double Draine::cumulative(double c) const {
  const double n = 1.0 / norm();
  if (std::abs(g) < 0.02) {
    // HG / (1/4 pi) = 1 + 3 g u + g^2 (15 u^2 - 5) / 2 + O(g^3)
    const auto term = [&](double u) {
      const double u2 = u * u;
      const double plain = u + 1.5 * g * u2 + g * g * (2.5 * u * u2 - 2.5 * u);
      const double squared = u * u2 / 3 + 0.75 * g * u2 * u2 + g * g * (1.5 * u * u2 * u2 - 2.5 / 3 * u * u2);
      return plain + alpha * squared;
    };
    return std::clamp(0.5 * n * (term(c) - term(-1.0)), 0.0, 1.0);
  }
  const double a = 1.0 + g * g;
  const auto term = [&](double u) {
    const double d = a - 2.0 * g * u, root = std::sqrt(d);
    const double plain = 1.0 / (g * root);
    const double squared = (a * a / root + 2.0 * a * root - d * root / 3.0) / (4.0 * g * g * g);
    return plain + alpha * squared;
  };
  return std::clamp(0.5 * (1.0 - g * g) * n * (term(c) - term(-1.0)), 0.0, 1.0);
}

double Draine::sample_cosine(double xi) const {
  double low = -1.0, high = 1.0, c = HenyeyGreenstein{g}.sample_cosine(xi);
  if (alpha == 0) return c;
  for (int i = 0; i < 60; ++i) {
    const double error = cumulative(c) - xi;
    (error > 0 ? high : low) = c;
    const double step = error / (2.0 * kPi * value(c));
    double next = c - step;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - c) < 1e-12) return next;
    c = next;
  }
  return c;
}

PhaseFunction PhaseFunction::mie(double d) {
  const double g_spike = std::exp(-0.0990567 / (d - 1.67154)), g_body = std::exp(-2.20679 / (d + 3.91029) - 0.428934);
  const double alpha = std::exp(3.62489 - 8.29288 / (d + 5.52825));
  const double weight = std::exp(-0.599085 / (d - 0.641583) - 0.665888);
  return {{g_spike}, {g_body, alpha}, weight};
}

}  // namespace brume
