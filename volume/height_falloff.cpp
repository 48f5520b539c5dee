#include "volume/height_falloff.h"

#include <cmath>
#include <limits>

namespace brume {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
// Below it two terms of a series are exact to rounding.
constexpr double kLevel = 1e-9;

/// (1 - e^-x) / x for x >= 0.
double mean_attenuation(double x) {
  return x < kLevel ? 1 - 0.5 * x : -std::expm1(-x) / x;
}

/// How far a ray that climbs from a height >= 0 goes until the integral reaches a value.
double climbs(double height, double climb, double value) {
  // e^-height (1 - e^(-climb s)) / climb = value
  const double level = value * std::exp(height), x = climb * level;
  if (!(x < 1)) return kNever;
  return x < kLevel ? level * (1 + 0.5 * x) : -std::log1p(-x) / climb;
}

/// The same of one that sinks by `fall` for each unit of t and has not reached the plane.
double sinks(double height, double fall, double value) {
  // e^-height (e^(fall s) - 1) / fall = value
  const double level = value * std::exp(height), x = fall * level;
  if (x < kLevel) return level * (1 - 0.5 * x);
  // From large heights the exponential overflows, and 1 is nothing beside it.
  return (x < 1e18 ? std::log1p(x) : std::log(fall) + std::log(value) + height) / fall;
}

}  // namespace

double HeightFalloff::integral(const Ray& ray, double t0, double t1) const {
  const double a = height(ray.at(t0)), b = height(ray.at(t1)), low = std::min(a, b), high = std::max(a, b);
  const double length = t1 - t0;
  if (high <= 0) return length;
  if (low >= 0) return length * std::exp(-low) * mean_attenuation(high - low);
  const double below = -low / (high - low);
  return length * (below + (1 - below) * mean_attenuation(high));
}

double HeightFalloff::reaches(const Ray& ray, double t0, double value) const {
  const double from = height(ray.at(t0)), climb = glm::dot(slope, ray.d);
  if (from <= 0) {
    // It may leave what is full.
    const double full = climb > 0 ? -from / climb : kNever;
    return value <= full ? t0 + value : t0 + full + climbs(0, climb, value - full);
  }
  if (climb >= 0) return t0 + climbs(from, climb, value);
  const double full = from / -climb, gathered = full * mean_attenuation(from);
  return value < gathered ? t0 + std::min(sinks(from, -climb, value), full) : t0 + full + (value - gathered);
}

}  // namespace brume
