#pragma once
#include <array>

#include "base/vec.h"

namespace brume {

/// What a coloured albedo makes of light that was solved for the mean of the colours: scattered n times, it has the
/// n-th power of the albedo's colour.
class OrderTint {
 public:
  OrderTint() = default;
  /// @param once  how much more than the mean the albedo gives each colour
  explicit OrderTint(const dvec3& once);
  dvec3 at(double order) const;
  const dvec3& once() const { return once_; }
  /// Of light that was scattered by forward peaks.
  const dvec3& forward() const { return forward_; }
  /// Of the mean number of scatterings that a guide of GuideLight::kFirstOrder stands for.
  const dvec3& of_guide(size_t guide) const { return of_guide_[guide]; }

 private:
  static constexpr std::array<double, 6> kTypicalOrder = {2, 3, 4.5, 7, 11, 20};
  static constexpr double kForwardOrder = 2.5;
  dvec3 once_{1}, log_{0}, forward_{1};
  std::array<dvec3, kTypicalOrder.size()> of_guide_{dvec3(1), dvec3(1), dvec3(1), dvec3(1), dvec3(1), dvec3(1)};
};

}  // namespace brume
