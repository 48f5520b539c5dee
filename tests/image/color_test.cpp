#include "image/color.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "base/error.h"
#include "image/color_space.h"

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

void expect_matrix(const std::optional<dmat3>& got, const double (&rows)[3][3]) {
  ASSERT_TRUE(got);
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      EXPECT_NEAR((*got)[column][row], rows[row][column], 5e-4) << row << ' ' << column;
}

// The matrices that the ACES and ITU documents and their users print.
TEST(ColorSpace, ConvertsToRec709AsPublished) {
  EXPECT_FALSE(rec709_from(kRec709, "x"));
  EXPECT_FALSE(rec709_from({0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.31271f, 0.32902f}, "x"));
  expect_matrix(rec709_from({0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f}, "x"),
                {{1.70505, -0.62179, -0.08326}, {-0.13026, 1.14080, -0.01055}, {-0.02400, -0.12897, 1.15297}});
  expect_matrix(rec709_from(kAces, "x"),
                {{2.52169, -1.13413, -0.38756}, {-0.27648, 1.37272, -0.09624}, {-0.01538, -0.15298, 1.16835}});
  expect_matrix(rec709_from({0.708f, 0.292f, 0.17f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.329f}, "x"),
                {{1.6605, -0.5876, -0.0728}, {-0.1246, 1.1329, -0.0083}, {-0.0182, -0.1006, 1.1187}});
  expect_matrix(rec709_from({0.68f, 0.32f, 0.265f, 0.69f, 0.15f, 0.06f, 0.3127f, 0.329f}, "x"),
                {{1.2249, -0.2247, 0}, {-0.0420, 1.0419, 0}, {-0.0197, -0.0786, 1.0979}});
}

TEST(ColorSpace, WhiteStaysWhiteAndHasAName) {
  const std::pair<Chromaticities, const char*> spaces[] = {
      {{0.68f, 0.32f, 0.265f, 0.69f, 0.15f, 0.06f, 0.314f, 0.351f}, "P3 (DCI)"},
      {{1, 0, 0, 1, 0, 0, 1.0f / 3, 1.0f / 3}, "CIE XYZ"},
      {{0.64f, 0.33f, 0.29f, 0.6f, 0.15f, 0.06f, 0.333f, 0.333f}, "Radiance's RGB"},
      {{0.735f, 0.265f, 0.274f, 0.717f, 0.167f, 0.009f, 0.34567f, 0.3585f}, "0.735 0.265"},
  };
  for (const auto& [space, name] : spaces) {
    const std::optional<dmat3> matrix = rec709_from(space, "x");
    ASSERT_TRUE(matrix);
    const dvec3 white = *matrix * dvec3(1);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(white[c], 1, 1e-6) << name;
    EXPECT_NE(name_of(space).find(name), std::string::npos) << name_of(space);
  }
  // X, Y, Z of Rec. 709's red in units of its white's.
  const dvec3 red = *rec709_from({1, 0, 0, 1, 0, 0, 0.3127f, 0.3290f}, "x") *
                    dvec3(0.4124564 / 0.95047, 0.2126729, 0.0193339 / 1.08883);
  EXPECT_NEAR(red.x, 1, 1e-3);
  EXPECT_NEAR(red.y, 0, 1e-3);
  EXPECT_NEAR(red.z, 0, 1e-3);
}

TEST(ColorSpace, ChromaticitiesThatAreNoneAreRefused) {
  const std::pair<Chromaticities, const char*> spaces[] = {
      {{0, 0, 0, 0, 0, 0, 0, 0}, "lie on one line"},
      {{0.6f, 0.3f, 0.4f, 0.3f, 0.2f, 0.3f, 0.31f, 0.33f}, "lie on one line"},
      {{0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3f, 0}, "its white is no colour"},
      {{0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.05f, 0.9f}, "its white lies outside"},
      {{std::nanf(""), 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.31f, 0.33f}, "not all of them are numbers"},
  };
  for (const auto& [space, why] : spaces) {
    std::string message;
    try {
      rec709_from(space, "a.exr");
    } catch (const InputError& error) {
      message = error.what();
    }
    EXPECT_TRUE(message.starts_with("a.exr: chromaticities ")) << message;
    EXPECT_NE(message.find(why), std::string::npos) << message;
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
