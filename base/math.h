#pragma once
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace brume {

inline constexpr double kPi = std::numbers::pi;

// The C library picks its log and sin by instruction set, so their last bits differ between machines. The sampling loop
// uses these instead: plain IEEE arithmetic, the same bits everywhere.

/// Natural logarithm of a positive normal number; relative error below 2e-13 (tests/base/math_test.cpp).
inline double portable_log(double x) {
  const uint64_t bits = std::bit_cast<uint64_t>(x);
  // Split x = 2^e m with m in [sqrt(1/2), sqrt(2)), where the atanh series converges fast.
  const uint64_t shifted = bits - 0x3FE6A09E667F3BCDull;
  const int e = static_cast<int>(static_cast<int64_t>(shifted) >> 52);
  const double m = std::bit_cast<double>(bits - (static_cast<uint64_t>(static_cast<int64_t>(e)) << 52));
  const double s = (m - 1.0) / (m + 1.0), z = s * s;
  const double p =
      2.0 +
      z * (2.0 / 3 + z * (2.0 / 5 + z * (2.0 / 7 + z * (2.0 / 9 + z * (2.0 / 11 + z * (2.0 / 13 + z * (2.0 / 15)))))));
  return e * std::numbers::ln2 + s * p;
}

struct SinCos {
  double sin, cos;
};

/// sin and cos of 2 pi u for u in [0, 1); absolute error below 1e-11 (tests/base/math_test.cpp).
inline SinCos portable_sincos_2pi(double u) {
  const double quadrant = std::floor(4.0 * u + 0.5);
  const double a = (u - 0.25 * quadrant) * (2.0 * kPi), z = a * a;
  const double s =
      a * (1.0 + z * (-1.0 / 6 + z * (1.0 / 120 + z * (-1.0 / 5040 + z * (1.0 / 362880 + z * (-1.0 / 39916800))))));
  const double c =
      1.0 + z * (-0.5 + z * (1.0 / 24 + z * (-1.0 / 720 + z * (1.0 / 40320 + z * (-1.0 / 3628800 + z / 479001600.0)))));
  switch (static_cast<int>(quadrant) & 3) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case 2:
      return {-s, -c};
    default:
      return {-c, s};
  }
}

}  // namespace brume
