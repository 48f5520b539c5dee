#include "volume/phase_function.h"

#include <gtest/gtest.h>

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

TEST(HenyeyGreenstein, TheTwoSamplingFormsMeet) {
  for (double xi = 0.01; xi < 1; xi += 0.07)
    for (const double sign : {-1.0, 1.0})
      EXPECT_NEAR(HenyeyGreenstein{sign * 0.4999999999}.sample_cosine(xi),
                  HenyeyGreenstein{sign * 0.5}.sample_cosine(xi), 1e-8);
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

}  // namespace
}  // namespace brume
