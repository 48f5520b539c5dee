#include "evaluate/metrics/flip.h"

#include <gtest/gtest.h>

#include <cmath>

namespace brume {
namespace {

constexpr int kWidth = 64, kHeight = 48;

float pattern(float x, float y, float c) {
  return 0.5f + 0.4f * std::sin(0.35f * x + 0.8f * c) * std::cos(0.21f * y - 0.5f * c);
}

float disturbance(int x, int y, float c) {
  const float wave = std::sin(1.7f * static_cast<float>(x) + 2.3f * static_cast<float>(y) + 1.1f * c);
  return 0.25f * wave + ((x / 8 + y / 8) % 2 ? 0.1f : 0.0f);
}

struct Pair {
  std::array<Plane, 3> test, reference;
  RgbPlanes test_view() const { return {&test[0], &test[1], &test[2]}; }
  RgbPlanes reference_view() const { return {&reference[0], &reference[1], &reference[2]}; }
};

Pair pictures(float (*change)(float)) {
  Pair pair;
  for (size_t c = 0; c < 3; ++c) {
    pair.test[c] = pair.reference[c] = Plane(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const auto channel = static_cast<float>(c);
        const float value = pattern(static_cast<float>(x), static_cast<float>(y), channel);
        pair.reference[c](x, y) = change(value);
        pair.test[c](x, y) = change(value + disturbance(x, y, channel));
      }
  }
  return pair;
}

double mean(const Plane& map) {
  double sum = 0;
  for (int y = 0; y < map.height(); ++y)
    for (const float v : map.pixels(y)) sum += v;
  return sum / (static_cast<double>(map.width()) * map.height());
}

// The numbers are those of the authors' own program, NVlabs/flip at commit 1eb247c, for the same pictures.
TEST(Flip, EqualsTheAuthorsProgram) {
  const Pair pair = pictures([](float v) { return std::clamp(v, 0.0f, 1.0f); });
  const Plane map = flip_map(pair.test_view(), pair.reference_view(), {});
  EXPECT_NEAR(mean(map), 0.193784, 1e-4);
  EXPECT_NEAR(map(10, 7), 0.272488, 1e-3);
  EXPECT_NEAR(map(63, 47), 0.344750, 1e-3) << "the border is continued";
  EXPECT_NEAR(map(0, 20), 0.134981, 1e-3);
}

TEST(HdrFlip, EqualsTheAuthorsProgram) {
  const Pair pair = pictures([](float v) { return 20 * std::pow(std::abs(v), 4.0f) + 0.01f; });
  const std::vector<double> exposures = hdr_flip_exposures(pair.reference_view());
  ASSERT_EQ(exposures.size(), 3u);
  EXPECT_NEAR(exposures.front(), -2.391476, 1e-4);
  EXPECT_NEAR(exposures.back(), 0.490609, 1e-4);
  const Plane map = hdr_flip_map(pair.test_view(), pair.reference_view(), {});
  EXPECT_NEAR(mean(map), 0.515826, 1e-4);
  EXPECT_NEAR(map(10, 7), 0.741890, 1e-3);
  EXPECT_NEAR(map(63, 47), 0.427581, 1e-3);
}

TEST(Flip, IsZeroForEqualPicturesAndNearlyOneForGreenAgainstBlue) {
  const Pair pair = pictures([](float v) { return v; });
  EXPECT_EQ(mean(flip_map(pair.reference_view(), pair.reference_view(), {})), 0.0);
  EXPECT_EQ(mean(hdr_flip_map(pair.reference_view(), pair.reference_view(), {})), 0.0);
  const Plane none(9, 5, 0.0f), full(9, 5, 1.0f);
  EXPECT_NEAR(mean(flip_map({&none, &full, &none}, {&none, &none, &full}, {})), 1.0, 1e-4)
      << "no two colours differ more";
}

TEST(Flip, DoesNotDependOnTheNumberOfThreads) {
  const Pair pair = pictures([](float v) { return v; });
  const Plane one = flip_map(pair.test_view(), pair.reference_view(), {1, {}, nullptr});
  const Plane seven = flip_map(pair.test_view(), pair.reference_view(), {7, {}, nullptr});
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) ASSERT_EQ(one(x, y), seven(x, y));
}

// Half of the picture black: the exposures end where the rest is visible, not at infinity.
TEST(HdrFlip, ABlackBackgroundHasNoExposure) {
  Plane plane(10, 10, 0.0f);
  for (int x = 0; x < 10; ++x) plane(x, 0) = plane(x, 1) = 0.5f;
  const std::vector<double> exposures = hdr_flip_exposures({&plane, &plane, &plane});
  EXPECT_EQ(exposures.size(), 2u);
  EXPECT_NEAR(exposures.front(), exposures.back(), 1e-6);
}

}  // namespace
}  // namespace brume
