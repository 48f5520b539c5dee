#include "filters/student.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

/// Continued fraction of the incomplete beta function, evaluated by Lentz's method (DLMF 8.17.22).
double beta_fraction(double a, double b, double x) {
  constexpr double kTiny = 1e-300;
  const auto nonzero = [](double v) { return std::abs(v) < kTiny ? kTiny : v; };
  double c = 1, d = 1 / nonzero(1 - (a + b) * x / (a + 1)), f = d;
  for (int m = 1; m <= 500; ++m) {
    const double even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m));
    d = 1 / nonzero(1 + even * d), c = nonzero(1 + even / c), f *= d * c;
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1));
    d = 1 / nonzero(1 + odd * d), c = nonzero(1 + odd / c);
    const double step = d * c;
    f *= step;
    if (std::abs(step - 1) < 1e-14) break;
  }
  return f;
}

double regularised_beta(double a, double b, double x) {
  if (x <= 0) return 0;
  if (x >= 1) return 1;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
  return x < (a + 1) / (a + b + 2) ? front * beta_fraction(a, b, x) / a : 1 - front * beta_fraction(b, a, 1 - x) / b;
}

/// P(|T| > t), which keeps its digits in the tails.
double tail(double t, double dof) {
  return dof > 200 ? std::erfc(t / std::sqrt(2.0)) : regularised_beta(dof / 2, 0.5, dof / (dof + t * t));
}

}  // namespace

double student_quantile(double confidence, double degrees_of_freedom) {
  const double alpha = 1 - confidence;
  double low = 0, high = 1;
  while (tail(high, degrees_of_freedom) > alpha && high < 1e9) high *= 2;
  for (int i = 0; i < 100 && high - low > 1e-9 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (tail(middle, degrees_of_freedom) > alpha ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace brume
