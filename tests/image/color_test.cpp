#include "image/color.h"

#include <gtest/gtest.h>

#include <limits>

namespace brume {
namespace {

void expect_lab(const dvec3& rgb, const dvec3& lab) {
  const dvec3 got = lab_from_rgb(rgb);
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(got[c], lab[c], 0.01) << "channel " << c << " of " << rgb.x << " " << rgb.y << " " << rgb.z;
}

// docs/methods.md, Metrics; the primaries of sRGB.
TEST(Lab, KnownColours) {
  expect_lab({1, 1, 1}, {100, 0, 0});
  expect_lab({0.18, 0.18, 0.18}, {49.50, 0, 0});
  expect_lab({1, 0, 0}, {53.24, 80.09, 67.20});
  expect_lab({0, 1, 0}, {87.73, -86.18, 83.18});
  expect_lab({0, 0, 1}, {32.30, 79.19, -107.86});
  expect_lab({0, 0, 0}, {0, 0, 0});
  expect_lab({100, 100, 100}, {522.42, 0, 0});
}

TEST(Lab, IsInvertedExactlyBelowZeroAndAboveOne) {
  for (const double scale : {-3.0, -0.01, 1e-9, 0.004, 0.0089, 0.5, 1.0, 40.0, 1e6})
    for (const dvec3& hue : {dvec3(1, 1, 1), dvec3(1, 0.2, 0), dvec3(0.1, 0.4, 2), dvec3(-1, 1, 0.5)}) {
      const dvec3 rgb = scale * hue, back = rgb_from_lab(lab_from_rgb(rgb));
      EXPECT_NEAR(glm::distance(back, rgb), 0.0, 1e-11 * glm::length(rgb) + 1e-13);
    }
}

TEST(SrgbEncode, MeetsItsEnds) {
  EXPECT_EQ(srgb_encode(-1), 0.0);
  EXPECT_NEAR(srgb_encode(1), 1.0, 1e-12);
  EXPECT_NEAR(srgb_encode(0.18), 0.4613, 1e-3);
}

TEST(FilmicShoulder, KeepsDarkTonesAndNeverPassesWhite) {
  EXPECT_EQ(filmic_shoulder(-0.5), -0.5);
  EXPECT_EQ(filmic_shoulder(0.18), 0.18);
  EXPECT_NEAR((filmic_shoulder(0.18 + 1e-6) - 0.18) / 1e-6, 1.0, 1e-5) << "leaves middle grey with slope 1";
  double last = 0.18;
  for (const double v : {0.2, 0.5, 1.0, 4.0, 100.0, 1e6}) {
    EXPECT_GT(filmic_shoulder(v), last);
    EXPECT_LT(filmic_shoulder(v), 1.0);
    last = filmic_shoulder(v);
  }
  EXPECT_EQ(filmic_shoulder(std::numeric_limits<double>::infinity()), 1.0);
}

}  // namespace
}  // namespace brume
