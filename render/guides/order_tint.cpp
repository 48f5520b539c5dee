#include "render/guides/order_tint.h"

#include "base/math.h"
#include "render/guides/attenuation.h"

namespace brume {

OrderTint::OrderTint(const GuideMedia& media, GuideColour colour) : colour_(colour) {
  if (colour != kGrey || media.media().empty()) return;
  const dvec3 albedo = media.media()[0].albedo();
  if (const double mean = in_colour(albedo, kGrey); mean > 0) once_ = albedo / mean;
  for (size_t i = 0; i < kTypicalOrder.size(); ++i) of_guide_[i] = at(kTypicalOrder[i]);
}

dvec3 OrderTint::at(double order) const {
  dvec3 result(0);
  for (int c = 0; c < 3; ++c) {
    if (!(once_[c] > 0)) continue;
    const double log = order * portable_log(once_[c]);
    result[c] = log < 0 ? attenuation(-log) : 1 / attenuation(log);
  }
  return result;
}

}  // namespace brume
