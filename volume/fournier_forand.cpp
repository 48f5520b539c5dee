#include "volume/fournier_forand.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

namespace brume {
namespace {

constexpr double kLeast = 2.5e-15;  // s of an angle of 1e-7
constexpr double kNearOne = 1e-3;   // of delta: series instead of differences that cancel

/// 1 - delta^nu.
double one_minus_power(double delta, double nu) {
  return -std::expm1(nu * std::log(delta));
}

}  // namespace

FournierForand::FournierForand(double index, double slope)
    : nu_(0.5 * (3 - slope)), scale_(4 / (3 * (index - 1) * (index - 1))) {
  correction_ = one_minus_power(scale_, nu_) / ((scale_ - 1) * std::pow(scale_, nu_));
  for (int i = 0; i <= kCells; ++i) table_[static_cast<size_t>(i)] = within(std::pow(kLeast, 1 - i / double{kCells}));
  // The mean of 1 - 2 s, by parts: 2 of the integral of within() over s, less 1; Simpson's rule in the cube root.
  constexpr int kSteps = 4000;
  double sum = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double x = i / double{kSteps}, weight = i == 0 || i == kSteps ? 1 : i % 2 ? 4 : 2;
    sum += weight * 3 * x * x * within(x * x * x);
  }
  mean_cosine_ = 2 * sum / (3 * kSteps) - 1;
}

double FournierForand::within(double s) const {
  if (!(s > 0)) return 0;
  if (s >= 1) return 1;
  const double delta = scale_ * s, e = 1 - delta;
  const double c = 1 - 2 * s, sine2 = 4 * s * (1 - s);
  double main;
  if (std::abs(e) < kNearOne) {
    // (1 - delta^nu) / (1 - delta) = nu - nu (nu - 1) / 2 e + ...
    const auto ratio = [&](double n) {
      return n * (1 - (n - 1) / 2 * e * (1 - (n - 2) / 3 * e * (1 - (n - 3) / 4 * e)));
    };
    main = (ratio(nu_ + 1) - ratio(nu_) * s) / std::pow(delta, nu_);
  } else {
    main = (one_minus_power(delta, nu_ + 1) - one_minus_power(delta, nu_) * s) / (e * std::pow(delta, nu_));
  }
  return std::clamp(main + correction_ * c * sine2 / 8, 0.0, 1.0);
}

double FournierForand::density(double s) const {
  s = std::max(s, kLeast);
  const double delta = scale_ * s, e = 1 - delta, power = std::pow(delta, nu_), n = nu_;
  double first, second;  // [nu (1 - delta) - (1 - delta^nu)] / e^2 and [delta (1 - delta^nu) - nu (1 - delta)] / e^2
  if (std::abs(e) < kNearOne) {
    const double c2 = n * (n - 1) / 2, c3 = c2 * (n - 2) / 3, c4 = c3 * (n - 3) / 4, c5 = c4 * (n - 4) / 5;
    // 1 - delta^nu = nu e - c2 e^2 + c3 e^3 - ...
    first = c2 - c3 * e + c4 * e * e - c5 * e * e * e;
    second = -(n + c2) + (c2 + c3) * e - (c3 + c4) * e * e + (c4 + c5) * e * e * e;
  } else {
    const double q = one_minus_power(delta, n);
    first = (n * e - q) / (e * e);
    second = (delta * q - n * e) / (e * e);
  }
  const double c = 1 - 2 * s;
  return (first + second / s) / (4 * kPi * power) + correction_ * (3 * c * c - 1) / (16 * kPi);
}

double FournierForand::value(double cos_theta) const {
  return std::max(0.0, density(0.5 * (1 - cos_theta)));
}

double FournierForand::sample_cosine(double xi) const {
  const double wanted = 1 - xi;
  const auto above = std::upper_bound(table_.begin(), table_.end(), wanted);
  if (above == table_.begin()) return 1;
  if (above == table_.end()) return -1;
  const auto i = static_cast<double>(above - table_.begin());
  const double range = -std::log(kLeast) / kCells, u = (wanted - above[-1]) / (above[0] - above[-1]);
  double low = -range * (kCells - i + 1), high = low + range, x = low + u * range;  // log s
  for (int k = 0; k < 60; ++k) {
    const double s = std::exp(x), error = within(s) - wanted;
    (error > 0 ? high : low) = x;
    // A ring of angles around s has the solid angle 4 pi ds.
    double next = x - error / (4 * kPi * s * std::max(density(s), 1e-300));
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - x) < 1e-12) break;
    x = next;
  }
  return 1 - 2 * std::exp(x);
}

}  // namespace brume
