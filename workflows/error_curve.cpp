#include "workflows/error_curve.h"

#include <algorithm>
#include <cmath>

namespace brume {

void ErrorCurve::add(double samples, double error) {
  if (!(samples > 0) || !(error > 0)) return;
  points_.push_back({std::log(samples), 2 * std::log(error)});
}

double ErrorCurve::decay() const {
  if (points_.empty()) return kUsualDecay;
  constexpr double kLeast = 0.15, kMost = 0.9;  // the curve flattens: a steep start promises too much
  constexpr double kForgetting = 0.7;           // of each older round: errors of few samples are the least certain
  double weights = 0, x = 0, y = 0;
  const auto weighted = [&](auto add) {
    double weight = 1;
    for (auto p = points_.rbegin(); p != points_.rend(); ++p, weight *= kForgetting) add(*p, weight);
  };
  weighted([&](const Point& p, double w) { weights += w, x += w * p.log_samples, y += w * p.log_square; });
  x /= weights, y /= weights;
  constexpr double kTrust = 0.24;  // (ln 2)^2 / 2: two rounds, a factor of two apart
  double xx = kTrust, xy = -kTrust * kUsualDecay;
  weighted([&](const Point& p, double w) {
    xx += w * (p.log_samples - x) * (p.log_samples - x);
    xy += w * (p.log_samples - x) * (p.log_square - y);
  });
  return std::clamp(-xy / xx, kLeast, kMost);
}

double ErrorCurve::samples_needed(double target) const {
  if (points_.empty() || !(target > 0)) return 0;
  constexpr double kMargin = 1.1;
  const Point& last = points_.back();
  return kMargin * std::exp(last.log_samples + (last.log_square - 2 * std::log(target)) / decay());
}

RoundsLeft rounds_left(double growth, double least, double most) {
  const int rounds = std::max(1, static_cast<int>(std::ceil(std::log(growth) / std::log(most) - 1e-9)));
  return {rounds, std::clamp(std::pow(growth, 1.0 / rounds), least, most)};
}

}  // namespace brume
