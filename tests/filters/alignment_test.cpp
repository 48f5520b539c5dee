// Frames of a sequence brought to where the frame to clean is.

#include "filters/run/alignment.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr int kWidth = 120, kHeight = 90;

/// A picture without a repeating pattern.
float picture(int x, int y) {
  const float u = static_cast<float>(x), v = static_cast<float>(y);
  return 2 + std::sin(0.11f * u + 0.05f * v) + std::cos(0.07f * v - 0.031f * u) + 0.5f * std::sin(0.003f * u * v);
}

/// The picture seen `shift` pixels further on, with noise of that deviation, which the frame knows.
Layers frame_at(ivec2 shift, float deviation, uint64_t seed, float gain = 1) {
  Layers frame(kWidth, kHeight);
  test::put(frame, layer::beauty, "", [&](int x, int y, size_t c) {
    return gain * picture(x + shift.x, y + shift.y) + deviation * static_cast<float>(test::normal(x, y, 3 * seed + c));
  });
  test::put(frame, layer::beauty, statistic::mean_variance, [&](int, int, size_t) { return deviation * deviation; });
  return frame;
}

/// Root mean square of what the other frame shows at the place of each inner pixel, less what the frame shows itself.
double left_over(const Layers& here, const Layers& there, const Alignment& alignment, double& found) {
  const Plane nowhere(kWidth, kHeight, NAN);
  const Plane brought = alignment.bring(there.at("G"), nowhere, {});
  double sum = 0, pixels = 0;
  for (int y = 20; y < kHeight - 20; ++y)
    for (int x = 20; x < kWidth - 20; ++x)
      if (std::isfinite(brought(x, y))) {
        sum += std::pow(static_cast<double>(brought(x, y)) - here.at("G")(x, y), 2);
        ++pixels;
      }
  found = pixels / ((kHeight - 40) * (kWidth - 40));
  return std::sqrt(sum / pixels);
}

TEST(Alignment, FindsAShiftToThePixel) {
  for (const ivec2& shift : {ivec2(0, 0), ivec2(1, 0), ivec2(-4, 3), ivec2(14, -9)}) {
    const Layers here = frame_at({0, 0}, 0, 1), there = frame_at(shift, 0, 2);
    double found = 0;
    const double rms = left_over(here, there, find_alignment(here, there, layer::beauty, {}), found);
    EXPECT_LT(rms, 0.01) << shift.x << " " << shift.y;
    EXPECT_GT(found, 0.9) << shift.x << " " << shift.y;
  }
}

TEST(Alignment, NoiseMovesNothingFar) {
  const Layers here = frame_at({0, 0}, 0.5f, 1), there = frame_at({6, 2}, 0.5f, 2), truth = frame_at({6, 2}, 0, 3);
  const Alignment alignment = find_alignment(here, there, layer::beauty, {});
  double found = 0;
  EXPECT_LT(left_over(frame_at({0, 0}, 0, 1), truth, alignment, found), 0.12);
  EXPECT_GT(found, 0.9);
}

TEST(Alignment, WhatChangedOrLeftThePictureIsNotFound) {
  const Layers here = frame_at({0, 0}, 0.1f, 1);
  double found = 0;
  const Layers brighter = frame_at({0, 0}, 0.1f, 2, 1.5f);
  left_over(here, brighter, find_alignment(here, brighter, layer::beauty, {}), found);
  EXPECT_LT(found, 0.05);
  const Layers there = frame_at({30, 0}, 0.1f, 2);
  const Alignment away = find_alignment(here, there, layer::beauty, {});
  const Plane own(kWidth, kHeight, -1);
  const Plane brought = away.bring(there.at("G"), own, {});
  int nowhere = 0;
  for (int y = 20; y < kHeight - 20; ++y) nowhere += brought(2, y) == -1;
  EXPECT_GT(nowhere, (kHeight - 40) * 3 / 4);
}

}  // namespace
}  // namespace brume
