#include "base/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "base/running_statistics.h"

namespace brume {
namespace {

TEST(Rng, IsAFunctionOfItsKeyAlone) {
  const SampleKey key{7, 1, 99, 3};
  Rng a(key), b(key);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(a.bits(), b.bits());
  std::set<uint32_t> first;
  for (uint32_t k = 0; k < 1000; ++k) first.insert(Rng(SampleKey{7, 1, 99, k}).bits());
  EXPECT_GT(first.size(), 995u);
}

TEST(Rng, NeverReachesTheEndsSoThatLogarithmsAreFinite) {
  Rng rng(1);
  for (int i = 0; i < 100000; ++i) {
    const double u = rng.uniform();
    ASSERT_GT(u, 0.0);
    ASSERT_LT(u, 1.0);
    ASSERT_TRUE(std::isfinite(rng.exponential()));
  }
}

// 1e6 draws: a bias of the mean of 0.003, of the variance of 0.012, would be seen at 3 standard errors.
TEST(Rng, ExponentialHasUnitMeanAndVariance) {
  Rng rng(2);
  RunningStatistics s;
  for (int i = 0; i < 1000000; ++i) s.add(rng.exponential());
  EXPECT_NEAR(s.mean, 1.0, 4e-3);
  EXPECT_NEAR(s.sample_variance(), 1.0, 0.012);
}

TEST(Sobol, IsANetInEveryPairOfDimensions) {
  // 256 samples of one half: each elementary interval of area 1/256 holds exactly one point.
  for (const uint32_t pair : {0u, 1u, 7u})
    for (int log_x = 0; log_x <= 8; ++log_x) {
      std::set<int> seen;
      for (uint32_t i = 0; i < 256; ++i) {
        const dvec2 p = Sobol(SampleKey{5, 0, 12, 2 * i}).pair(pair);
        ASSERT_GE(p.x, 0.0);
        ASSERT_LT(p.x, 1.0);
        seen.insert((static_cast<int>(p.x * (1 << log_x)) << (8 - log_x)) | static_cast<int>(p.y * (1 << (8 - log_x))));
      }
      EXPECT_EQ(seen.size(), 256u) << "pair " << pair << ", split " << log_x;
    }
}

// The two halves are independent: the correlation of their means over 2000 pixels is below 3 standard errors (0.067).
TEST(Sobol, HalvesAreIndependent) {
  double ab = 0, aa = 0, bb = 0;
  for (uint32_t pixel = 0; pixel < 2000; ++pixel) {
    double mean[2] = {};
    for (uint32_t i = 0; i < 16; ++i) {
      const dvec2 p = Sobol(SampleKey{3, 0, pixel, i}).pair(0);
      mean[i & 1] += (p.x * p.x + p.y > 0.8 ? 1.0 : 0.0) / 8;
    }
    // Expectation by area: 1 - int_0^1 max(0, .8 - x^2) dx.
    const double expected = 1 - 2.0 / 3.0 * std::pow(0.8, 1.5);
    ab += (mean[0] - expected) * (mean[1] - expected);
    aa += (mean[0] - expected) * (mean[0] - expected);
    bb += (mean[1] - expected) * (mean[1] - expected);
  }
  EXPECT_LT(std::abs(ab / std::sqrt(aa * bb)), 0.067);
}

TEST(RunningStatistics, AMillionSamplesLoseNothingAndPartsMerge) {
  RunningStatistics whole, a, b;
  for (int i = 0; i < 1000000; ++i) {
    const double x = 1e6 + i % 3;  // mean 1000001, variance 2/3, up to the odd one out
    whole.add(x);
    (i < 300000 ? a : b).add(x);
  }
  a.merge(b);
  EXPECT_NEAR(whole.mean, 1e6 + 1, 1e-5);
  EXPECT_NEAR(whole.sample_variance(), 2.0 / 3, 1e-5);
  EXPECT_EQ(a.count, whole.count);
  EXPECT_NEAR(a.mean, whole.mean, 1e-9 * whole.mean);
  EXPECT_NEAR(a.sample_variance(), whole.sample_variance(), 1e-8);
}

}  // namespace
}  // namespace brume
