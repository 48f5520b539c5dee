#include "volume/phase_function.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/rng.h"

namespace brume {
namespace {

const double kAnisotropies[] = {0, 1e-4, -1e-4, 0.3, -0.499, 0.5, 0.6, -0.9, 0.99, -0.999, 0.999};

TEST(HenyeyGreenstein, IntegratesToOneWithMeanCosineG) {
  for (const double g : kAnisotropies) {
    const HenyeyGreenstein phase{g};
    // By substitution with the sampling itself: c(xi) makes the integrand smooth even for needles.
    double integral = 0, mean = 0;
    const int n = 200000;
    for (int i = 0; i < n; ++i) {
      const double a = phase.sample_cosine(static_cast<double>(i) / n), b = phase.sample_cosine((i + 1.0) / n),
                   c = phase.sample_cosine((i + 0.5) / n);
      integral += 2 * kPi * (b - a) * (phase.value(a) + 4 * phase.value(c) + phase.value(b)) / 6;
      mean += c / n;
    }
    EXPECT_NEAR(integral, 1.0, 1e-5) << g;
    EXPECT_NEAR(mean, g, 1e-5) << g;
  }
}

TEST(HenyeyGreenstein, PeakAndIsotropy) {
  EXPECT_NEAR(HenyeyGreenstein{0.99}.value(1), 1.99 / (4 * kPi * 0.01 * 0.01), 1e-6);
  EXPECT_NEAR(HenyeyGreenstein{-0.99}.value(-1), 1.99 / (4 * kPi * 0.01 * 0.01), 1e-6);
  for (const double c : {-1.0, 0.2, 1.0}) EXPECT_DOUBLE_EQ(HenyeyGreenstein{0}.value(c), 1 / (4 * kPi));
  for (const double xi : {0.0, 0.25, 1.0}) EXPECT_NEAR(HenyeyGreenstein{0}.sample_cosine(xi), 2 * xi - 1, 1e-15);
}

// Chi-square over 32 x 8 bins of equal probability, 256000 draws per g, Sidak-corrected to 1e-4 over all: a bin whose
// probability is off by 20 % would be found.
TEST(HenyeyGreenstein, SampledDirectionsFollowTheDensity) {
  for (const double g : kAnisotropies) {
    const HenyeyGreenstein phase{g};
    const dvec3 forward = glm::normalize(dvec3(0.3, -0.5, 0.8));
    const Frame frame(forward);
    std::vector<double> edges;
    for (int i = 0; i <= 32; ++i) edges.push_back(phase.sample_cosine(i / 32.0));
    std::vector<int> bins(32 * 8);
    Rng rng(5);
    const int n = 256000;
    for (int i = 0; i < n; ++i) {
      const dvec3 d = PhaseFunction::henyey_greenstein(phase.g).sample(forward, {rng.uniform(), rng.uniform()});
      ASSERT_NEAR(glm::length(d), 1.0, 1e-12);
      const double c = glm::dot(d, forward),
                   phi = std::atan2(glm::dot(d, frame.y), glm::dot(d, frame.x)) / (2 * kPi) + 0.5;
      const auto row = std::upper_bound(edges.begin() + 1, edges.end() - 1, c) - edges.begin() - 1;
      ++bins[static_cast<size_t>(row * 8 + std::min(7, static_cast<int>(phi * 8)))];
    }
    double chi2 = 0;
    const double expected = n / 256.0;
    for (const int b : bins) chi2 += (b - expected) * (b - expected) / expected;
    // 255 degrees of freedom: mean 255, standard deviation 22.6; 4.4 deviations is p = 1e-5.
    EXPECT_LT(chi2, 255 + 4.6 * 22.6) << g;
  }
}

// Draine, two lobes and the Mie fit: normalised, and 64 bins of the cosine whose probabilities come from integrating
// the density, 200000 draws: a bin that is off by 10 % would be found.
TEST(PhaseFunction, MixturesAreNormalisedAndSampledByTheirDensity) {
  const PhaseFunction cases[] = {PhaseFunction::two_lobes(0.8, -0.4, 0.3),
                                 PhaseFunction::mie(5),
                                 PhaseFunction::mie(20),
                                 PhaseFunction::mie(50),
                                 PhaseFunction::draine(0.01, 3),
                                 PhaseFunction::draine(0.6, 20),
                                 PhaseFunction::draine(0, 1)};
  Rng rng(7);
  int which = 0;
  for (const double c : {-1.0, -0.3, 0.0, 0.7})
    EXPECT_NEAR(PhaseFunction::draine(0, 1).value(c), 3 * (1 + c * c) / (16 * kPi), 1e-15) << "Rayleigh's";
  for (const PhaseFunction& phase : cases) {
    constexpr int kBins = 64;
    // Finer towards the forward peak: cos = 1 - 2 x^3.
    const auto edge = [](double x) { return 1.0 - 2.0 * x * x * x; };
    double probability[kBins], total = 0, mean = 0;
    for (int b = 0; b < kBins; ++b) {
      probability[b] = 0;
      constexpr int kSteps = 2000;
      for (int k = 0; k < kSteps; ++k) {
        const double high = edge((b + k / static_cast<double>(kSteps)) / kBins),
                     low = edge((b + (k + 1) / static_cast<double>(kSteps)) / kBins), c = 0.5 * (high + low);
        const double p = 2 * kPi * (high - low) * (phase.value(low) + 4 * phase.value(c) + phase.value(high)) / 6;
        probability[b] += p;
        mean += p * c;
      }
      total += probability[b];
    }
    EXPECT_NEAR(total, 1.0, 1e-4) << which;
    std::vector<int> count(kBins);
    double sampled_mean = 0;
    const int n = 200000;
    for (int k = 0; k < n; ++k) {
      const double c = phase.sample_cosine(rng.uniform());
      sampled_mean += c / n;
      ++count[static_cast<size_t>(std::min(kBins - 1.0, kBins * std::cbrt(0.5 * (1.0 - c))))];
    }
    EXPECT_NEAR(sampled_mean, mean, 5 / std::sqrt(static_cast<double>(n))) << which;
    double chi2 = 0, degrees = -1;
    for (int b = 0; b < kBins; ++b) {
      const double expected = n * probability[b];
      if (expected < 10) continue;
      chi2 += (count[static_cast<size_t>(b)] - expected) * (count[static_cast<size_t>(b)] - expected) / expected;
      ++degrees;
    }
    EXPECT_LT(chi2, degrees + 4.6 * std::sqrt(2 * degrees)) << which;
    ++which;
  }
  // The mean cosine of cloud droplets of 20 micrometres is about 0.86.
  const PhaseFunction cloud = PhaseFunction::mie(20);
  double g = 0;
  for (int k = 0; k < 100000; ++k) g += cloud.sample_cosine((k + 0.5) / 100000) / 100000;
  EXPECT_NEAR(g, 0.86, 0.02);
}

}  // namespace
}  // namespace brume
