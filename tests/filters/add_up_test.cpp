#include "filters/run/add_up.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "base/rng.h"

namespace brume {
namespace {

double sum_of(const std::vector<float>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

TEST(AddUp, SumsAreWithinHalfAUnitInTheLastPlace) {
  Rng rng(1);
  for (int round = 0; round < 10000; ++round) {
    std::vector<float> values;
    std::vector<double> weights;
    for (int i = 0; i < 5; ++i) {
      values.push_back(static_cast<float>(std::exp(8 * rng.uniform() - 6)));
      weights.push_back(rng.uniform() + 1e-30);
    }
    const auto sum = static_cast<float>(sum_of(values) * (0.2 + 1.6 * rng.uniform()));
    add_up_exactly(values, weights, static_cast<double>(sum));
    EXPECT_LE(std::abs(sum_of(values) - static_cast<double>(sum)),
              0.5 * static_cast<double>(std::nextafter(sum, 1e30f) - sum));
    for (const float v : values) EXPECT_GE(v, 0.0f);
  }
}

TEST(AddUp, SharesFollowTheWeights) {
  std::vector<float> values = {1, 2, 3};
  add_up_exactly(values, std::vector<double>{1, 0.5, 0.5}, 7);
  EXPECT_EQ(values, (std::vector<float>{1.5f, 2.25f, 3.25f}));
}

TEST(AddUp, WhatWouldFallBelow0StaysAt0) {
  std::vector<float> values = {0.25f, 4};
  add_up_exactly(values, std::vector<double>{1, 1}, 3);
  EXPECT_EQ(values, (std::vector<float>{0, 3}));
}

TEST(AddUp, ASumBelow0IsKept) {
  std::vector<float> values = {0, 0};
  add_up_exactly(values, std::vector<double>{1, 1}, -1);
  EXPECT_EQ(values, (std::vector<float>{-0.5f, -0.5f}));
}

}  // namespace
}  // namespace brume
