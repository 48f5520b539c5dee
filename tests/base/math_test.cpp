#include "base/math.h"

#include <gtest/gtest.h>

#include <cmath>

namespace brume {
namespace {

TEST(PortableLog, AgreesWithTheLibraryOverTheWholeRange) {
  for (double x = 1e-300; x < 1e300; x *= 1.37) {
    const double exact = std::log(x);
    EXPECT_NEAR(portable_log(x), exact, 2e-13 * std::max(1.0, std::abs(exact))) << x;
  }
  for (int i = 1; i < 2000; ++i) {
    const double x = i / 1000.0;
    EXPECT_NEAR(portable_log(x), std::log(x), 2e-13 * std::max(1.0, std::abs(std::log(x)))) << x;
  }
  EXPECT_EQ(portable_log(1.0), 0.0);
}

TEST(PortableSinCos, AgreesWithTheLibrary) {
  for (int i = 0; i < 10000; ++i) {
    const double u = i / 10000.0;
    const SinCos s = portable_sincos_2pi(u);
    EXPECT_NEAR(s.sin, std::sin(2 * kPi * u), 1e-11) << u;
    EXPECT_NEAR(s.cos, std::cos(2 * kPi * u), 1e-11) << u;
  }
}

}  // namespace
}  // namespace brume
