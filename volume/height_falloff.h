#pragma once
#include "volume/placement.h"

namespace brume {

/// A density that is 1 below a plane and falls off above it as exp(-height), height being counted in units in which it
/// falls to 1 / e. All in closed form, without cancellation along rays that are nearly level.
/// Derived in docs/estimators.md.  Proof: tests/volume/height_falloff_test.cpp
struct HeightFalloff {
  dvec3 slope{0};   ///< change of the height with the local coordinates
  double base = 0;  ///< where the plane is: dot(slope, p)

  double height(const dvec3& p) const { return glm::dot(slope, p) - base; }
  double density(const dvec3& p) const { return std::exp(-std::max(0.0, height(p))); }
  /// Integral of the density along a ray from t0 to t1 >= t0, both finite.
  double integral(const Ray& ray, double t0, double t1) const;
  /// Where on a ray that integral from t0 on reaches a positive value; kUnbounded where it never does.
  double reaches(const Ray& ray, double t0, double value) const;
};

}  // namespace brume
