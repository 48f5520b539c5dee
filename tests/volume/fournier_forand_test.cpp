// Fournier and Forand's phase function: what was published of it, normalisation, sampling.

#include "volume/fournier_forand.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/math.h"
#include "base/rng.h"
#include "volume/phase_function.h"

namespace brume {
namespace {

const std::pair<double, double> kParticles[] = {{1.1, 3.5835}, {1.05, 3.3}, {1.2, 4.5},
                                                {1.02, 4.9},   {1.3, 3.2},  {1.15, 4}};

/// Probability of angles with sin^2 of the half between two values, by quadrature of the density.
double probability(const FournierForand& phase, double from, double to) {
  constexpr int kSteps = 400;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const auto at = [&](double x) { return from * std::pow(to / from, x / kSteps); };
    const double a = at(i), b = at(i + 1), middle = at(i + 0.5);
    sum += 4 * kPi * middle * std::log(b / a) * phase.value(1 - 2 * middle);
  }
  return sum;
}

// Mobley, Sundman, Boss 2002: an index of 1.10 and a slope of 3.5835 stand for Petzold's mean, 0.0183 of which turns
// back.
TEST(FournierForand, TurnsBackWhatWasMeasured) {
  EXPECT_NEAR(FournierForand(1.10, 3.5835).backscatter(), 0.0183, 5e-5);
}

TEST(FournierForand, IntegratesToItsDistribution) {
  for (const auto& [index, slope] : kParticles) {
    const FournierForand phase(index, slope);
    double mean = 0, all = phase.cumulative(-1);
    EXPECT_NEAR(all, 0, 1e-12);
    constexpr int kParts = 600;
    for (int i = 0; i < kParts; ++i) {
      const auto edge = [](double x) { return std::pow(1e-12, 1 - x / kParts); };
      const double a = edge(i), b = edge(i + 1);
      const double p = phase.cumulative(1 - 2 * a) - phase.cumulative(1 - 2 * b);
      EXPECT_NEAR(probability(phase, a, b), p, 1e-3 * p + 1e-9) << index << " " << slope << " " << a;
      mean += p * (1 - (a + b));
    }
    mean += 1 - phase.cumulative(1 - 2e-12);
    EXPECT_NEAR(phase.mean_cosine(), mean, 5e-3) << index << " " << slope;
    for (double c = -1; c < 1; c += 0.01) EXPECT_GT(phase.value(c), 0) << index << " " << slope << " " << c;
  }
}

// 64 parts of equal probability, found in the quadrature of the density; 100000 draws, level 1e-5 each: a part that is
// off by 12 % would be found.
TEST(FournierForand, SampledAnglesFollowTheDensity) {
  Rng rng(11);
  for (const auto& [index, slope] : kParticles) {
    const PhaseFunction phase = PhaseFunction::fournier_forand(index, slope);
    constexpr int kParts = 64, kDraws = 100000;
    double least = phase.ocean->cumulative(1 - 2e-12), sum = 0;  // beyond: nearer to the axis
    std::vector<double> edges{1e-12}, expected{1 - least};
    for (int i = 0; i < kParts; ++i) {
      const double a = std::pow(1e-12, 1 - i / double{kParts}), b = std::pow(1e-12, 1 - (i + 1) / double{kParts});
      edges.push_back(b);
      expected.push_back(probability(*phase.ocean, a, b));
      sum += expected.back();
    }
    EXPECT_NEAR(sum, least, 1e-3);
    std::vector<int> count(kParts + 1);
    double mean = 0;
    for (int k = 0; k < kDraws; ++k) {
      const double c = phase.sample_cosine(rng.uniform()), s = 0.5 * (1 - c);
      mean += c / kDraws;
      ++count[s <= 1e-12 ? 0 : static_cast<size_t>(kParts - std::floor(kParts * std::log(s) / std::log(1e-12)))];
    }
    EXPECT_NEAR(mean, phase.ocean->mean_cosine(), 5 / std::sqrt(double{kDraws}));
    double chi2 = 0, degrees = -1;
    for (size_t i = 0; i <= kParts; ++i) {
      const double n = kDraws * expected[i];
      if (n < 10) continue;
      chi2 += (count[i] - n) * (count[i] - n) / n;
      ++degrees;
    }
    EXPECT_LT(chi2, degrees + 4.6 * std::sqrt(2 * degrees)) << index << " " << slope;
  }
}

TEST(FournierForand, InvertsItsDistribution) {
  for (const auto& [index, slope] : kParticles) {
    const FournierForand phase(index, slope);
    for (const double xi : {0.0, 1e-9, 0.01, 0.3, 0.5, 0.9})
      EXPECT_NEAR(phase.cumulative(phase.sample_cosine(xi)), xi, 1e-6) << index << " " << slope;
    EXPECT_TRUE(std::isfinite(phase.value(1)));
    EXPECT_EQ(phase.sample_cosine(1), 1);
  }
}

}  // namespace
}  // namespace brume
