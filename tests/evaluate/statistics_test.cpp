#include "evaluate/metrics/statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "base/math.h"
#include "base/rng.h"

namespace brume {
namespace {

double normal(Rng& rng) {
  return std::sqrt(-2 * std::log(1 - rng.uniform())) * std::cos(2 * kPi * rng.uniform());
}

// An experiment of five seeds, repeated 1,000 times: two methods whose errors are 2.0 and 1.7 and share most of their
// noise, as filters of the same frames do. The interval of the difference holds 0.3 in 95 +- 2 % of them.
TEST(PairedDifference, IntervalCoversTheTruthAsOftenAsItSays) {
  Rng rng(7);
  int covered = 0, told_apart = 0;
  for (int repetition = 0; repetition < 1000; ++repetition) {
    std::vector<double> a, b;
    for (int seed = 0; seed < 5; ++seed) {
      const double common = 0.4 * normal(rng);
      a.push_back(2.0 + common + 0.1 * normal(rng));
      b.push_back(1.7 + common + 0.1 * normal(rng));
    }
    const PairedDifference d = paired_difference(a, b);
    covered += std::abs(d.difference.mean - 0.3) <= d.difference.half_width;
    told_apart += d.p_value < 0.05;
  }
  EXPECT_NEAR(covered, 950, 20);
  EXPECT_GT(told_apart, 850) << "what both share does not hide the difference";
}

// Ten methods that are equal in truth: in at most 5 % of the experiments is any pair told apart.
TEST(Holm, KeepsTheChanceOfAnyFalseWinner) {
  Rng rng(8);
  int wrong = 0, wrong_without = 0;
  constexpr int kRepetitions = 600;
  for (int repetition = 0; repetition < kRepetitions; ++repetition) {
    std::vector<std::vector<double>> methods(10, std::vector<double>(5));
    for (auto& values : methods)
      for (double& v : values) v = normal(rng);
    std::vector<double> p_values;
    for (size_t i = 0; i < methods.size(); ++i)
      for (size_t k = i + 1; k < methods.size(); ++k)
        p_values.push_back(paired_difference(methods[i], methods[k]).p_value);
    const auto any = [](const auto& list, const auto& is) { return std::any_of(list.begin(), list.end(), is); };
    wrong += any(holm_significant(p_values), [](bool b) { return b; });
    wrong_without += any(p_values, [](double p) { return p < 0.05; });
  }
  EXPECT_LE(wrong, 0.05 * kRepetitions);
  EXPECT_GT(wrong_without, 0.3 * kRepetitions);
}

TEST(Holm, HandComputed) {
  // 0.01 <= 0.05 / 4, 0.013 <= 0.05 / 3, 0.03 > 0.05 / 2: the rest stays open whatever it is.
  EXPECT_EQ(holm_significant({0.03, 0.01, 0.04, 0.013}), (std::vector<bool>{false, true, false, true}));
  EXPECT_EQ(holm_significant({}), std::vector<bool>{});
}

TEST(PairedDifference, HandComputed) {
  // Differences 1, 2, 3: mean 2, standard error 1 / sqrt(3), t = 3.4641 with 2 degrees of freedom, p = 0.0742.
  const PairedDifference d = paired_difference({2, 4, 6}, {1, 2, 3});
  EXPECT_DOUBLE_EQ(d.difference.mean, 2);
  EXPECT_NEAR(d.difference.half_width, 4.3027 / std::sqrt(3.0), 1e-3);
  EXPECT_NEAR(d.p_value, 0.0742, 1e-4);
  EXPECT_EQ(paired_difference({1}, {2}).p_value, 1) << "one seed proves nothing";
  EXPECT_EQ(paired_difference({1, 1}, {1, 1}).p_value, 1);
  EXPECT_EQ(paired_difference({2, 2}, {1, 1}).p_value, 0);
  EXPECT_THROW(paired_difference({1, 2}, {1}), std::logic_error);
}

}  // namespace
}  // namespace brume
