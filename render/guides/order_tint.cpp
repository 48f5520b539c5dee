#include "render/guides/order_tint.h"

#include "base/math.h"
#include "render/guides/attenuation.h"

namespace brume {

OrderTint::OrderTint(const dvec3& once) : once_(once) {
  for (int c = 0; c < 3; ++c) log_[c] = once[c] > 0 ? portable_log(once[c]) : 0;
  forward_ = at(kForwardOrder);
  for (size_t i = 0; i < kTypicalOrder.size(); ++i) of_guide_[i] = at(kTypicalOrder[i]);
}

// All powers of 0 are 0.
dvec3 OrderTint::at(double order) const {
  dvec3 result(0);
  for (int c = 0; c < 3; ++c) {
    if (!(once_[c] > 0)) continue;
    const double log = order * log_[c];
    result[c] = log < 0 ? attenuation(-log) : 1 / attenuation(log);
  }
  return result;
}

}  // namespace brume
