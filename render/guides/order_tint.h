#pragma once
#include <array>

#include "render/guides/guide_media.h"

namespace brume {

/// What a coloured albedo makes of light that was solved for the mean of the colours: scattered n times, it has the
/// n-th power of the albedo's colour.
class OrderTint {
 public:
  OrderTint() = default;
  OrderTint(const GuideMedia& media, GuideColour colour);
  GuideColour colour() const { return colour_; }
  /// RGB; ones but in grey guides.
  dvec3 at(double order) const;
  dvec3 once() const { return once_; }
  /// Of the mean number of scatterings that a guide of GroupLight::kFirstOrder stands for.
  const dvec3& of_guide(size_t guide) const { return of_guide_[guide]; }

 private:
  static constexpr std::array<double, 6> kTypicalOrder = {2, 3, 4.5, 7, 11, 20};
  GuideColour colour_ = kGrey;
  dvec3 once_{1};  // how much more than the mean the albedo gives each colour
  std::array<dvec3, kTypicalOrder.size()> of_guide_{dvec3(1), dvec3(1), dvec3(1), dvec3(1), dvec3(1), dvec3(1)};
};

}  // namespace brume
