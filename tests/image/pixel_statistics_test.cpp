#include "image/pixel_statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "base/rng.h"

namespace brume {
namespace {

/// Rows of numbers over twelve orders of magnitude and both signs.
std::vector<float> rough_rows(size_t values, size_t count) {
  Rng rng(values);
  std::vector<float> rows(values * count);
  for (float& v : rows) v = static_cast<float>((rng.uniform() - 0.5) * std::pow(10.0, 12 * rng.uniform() - 6));
  return rows;
}

std::vector<double> means(const PixelSums& sums, const std::vector<double>& state, size_t group, size_t step,
                          size_t n) {
  std::vector<double> result(sums.values());
  sums.means(state.data(), group, step, n, result.data());
  return result;
}
std::vector<double> mean_variances(const PixelSums& sums, const std::vector<double>& state, size_t n) {
  std::vector<double> result(sums.values());
  sums.mean_variances(state.data(), n, result.data());
  return result;
}

// Numbers of values around every vector's length, so that no tail is left out.
TEST(PixelSums, MeansAndVariancesAreThoseOfTheSamples) {
  for (const size_t groups : {1, 2, 8})
    for (size_t values = 1; values <= 19; ++values) {
      const size_t count = 37, first = 5;
      const PixelSums sums(values, groups, true);
      const std::vector<float> rows = rough_rows(values, count);
      std::vector<double> state(sums.doubles(), 0.0);
      sums.add(state.data(), rows.data(), count, first);
      const std::vector<double> variances = mean_variances(sums, state, count);
      for (size_t v = 0; v < values; ++v) {
        std::vector<long double> total(groups, 0);
        std::vector<uint64_t> n(groups, 0);
        long double all = 0, square = 0, largest = 0;
        for (size_t s = 0; s < count; ++s) {
          const long double x = rows[s * values + v];
          total[(first + s) % groups] += x, ++n[(first + s) % groups];
          all += x;
          square += x * x;
          largest = std::max(largest, std::abs(x));
        }
        for (size_t g = 0; g < groups; ++g)
          EXPECT_NEAR(means(sums, state, g, groups, n[g])[v],
                      static_cast<double>(total[g] / static_cast<long double>(n[g])),
                      1e-14 * static_cast<double>(largest));
        const auto m = static_cast<long double>(count);
        const auto variance = static_cast<double>((square - all * all / m) / (m * (m - 1)));
        EXPECT_NEAR(variances[v] / variance, 1, 1e-12) << values << " " << groups;
      }
    }
}

TEST(PixelSums, AnySplitAndOrderGivesTheSameBits) {
  const size_t values = 13, count = 64;
  const PixelSums sums(values, 2, true);
  const std::vector<float> rows = rough_rows(values, count);
  std::vector<double> whole(sums.doubles(), 0.0), late = whole, early = whole;
  sums.add(whole.data(), rows.data(), count, 0);
  sums.add(late.data(), rows.data() + 40 * values, count - 40, 40);
  for (size_t s = 0; s < 40; ++s) sums.add(early.data(), rows.data() + s * values, 1, s);
  sums.merge(late.data(), early.data());
  EXPECT_EQ(means(sums, late, 0, 1, count), means(sums, whole, 0, 1, count));
  EXPECT_EQ(mean_variances(sums, late, count), mean_variances(sums, whole, count));
}

TEST(PixelSums, EqualSamplesHaveNoVariance) {
  const PixelSums sums(1, 2, true);
  for (const float x : {1.0f, 0.1f, 1e-7f, 3e6f}) {
    std::vector<double> state(sums.doubles(), 0.0);
    const std::vector<float> rows(1000, x);
    sums.add(state.data(), rows.data(), rows.size(), 0);
    EXPECT_EQ(mean_variances(sums, state, 1000)[0], 0) << x;
  }
}

// Large means with little on them: sixteen digits would lose all of it.
TEST(PixelSums, SmallVariancesOfLargeMeansAreKept) {
  const PixelSums sums(1, 2, true);
  for (const size_t n : {2, 1000}) {
    std::vector<float> rows(n, 4194304.0f);
    for (size_t s = 0; s < n; s += 2) rows[s] += 0.5f;
    std::vector<double> state(sums.doubles(), 0.0);
    sums.add(state.data(), rows.data(), n, 0);
    const auto m = static_cast<double>(n);
    EXPECT_DOUBLE_EQ(mean_variances(sums, state, n)[0], 0.0625 / (m - 1));
  }
}

TEST(PixelSums, NoSamplesNoMeanOneSampleNoVariance) {
  const PixelSums sums(3, 1, true);
  std::vector<double> state(sums.doubles(), 0.0);
  EXPECT_EQ(means(sums, state, 0, 1, 0), std::vector<double>(3, 0.0));
  sums.add(state.data(), std::array{1.0f, 2.0f, 3.0f}.data(), 1, 0);
  EXPECT_EQ(means(sums, state, 0, 1, 1), (std::vector<double>{1, 2, 3}));
  EXPECT_EQ(mean_variances(sums, state, 1), std::vector<double>(3, 0.0));
}

}  // namespace
}  // namespace brume
