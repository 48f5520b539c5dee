#pragma once
#include <cmath>

#include "filters/inputs/half_pair.h"
#include "tests/support/reference_regression.h"

namespace brume::test {

inline Values values_of(const Plane& plane) {
  Values v(plane.width() * plane.height());
  for (int i = 0; i < v.size(); ++i) v[i] = plane(i % plane.width(), i / plane.width());
  return v;
}

inline Halves halves_of(const HalfPair& pair) {
  const auto colours = [](const Rgb& rgb) { return Colours{values_of(rgb[0]), values_of(rgb[1]), values_of(rgb[2])}; };
  return {colours(pair.a), colours(pair.b)};
}

/// Root mean square difference where pixels are cleaned.
inline double apart(const Halves& a, const Halves& b, const Values& mask) {
  double squares = 0;
  for (size_t half = 0; half < 2; ++half)
    for (size_t c = 0; c < 3; ++c) squares += (mask * (a[half][c] - b[half][c]).square()).sum();
  return std::sqrt(squares / (6 * mask.sum()));
}

}  // namespace brume::test
