#include "volume/tracking.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/running_statistics.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

/// Density rising along x: 0.2 + 0.05 x, so that a chord's optical depth is a polynomial.
BrickGrid ramp() {
  return test::make_bricks({{0, 0, 0}, {40, 20, 20}},
                           [](const ivec3& v) { return 0.2f + 0.05f * static_cast<float>(v.x); });
}

TEST(OpticalDepth, IsExactOnARamp) {
  const BrickGrid grid = ramp();
  const Medium medium(grid, dmat4(1.0), 1.0, dvec3(1), 0);
  // From x = 2.25 to x = 37.5 at y = z = 10: a l + b l^2 / 2.
  const Ray ray{medium.to_local(dvec3(2.25, 10, 10)), dvec3(1, 0, 0)};
  const double x0 = 2.25, x1 = 37.5;
  EXPECT_NEAR(optical_depth(medium, ray, x1 - x0), 0.2 * (x1 - x0) + 0.025 * (x1 * x1 - x0 * x0), 1e-5);
}

TEST(OpticalDepth, IsExactOnAnyLineThroughTrilinearDensity) {
  const BrickGrid grid = test::make_bricks({{0, 0, 0}, {23, 23, 23}}, [](const ivec3& v) {
    return static_cast<float>((v.x * 7 + v.y * 3 + v.z * 5) % 11) / 11.0f;
  });
  Rng rng(3);
  for (int i = 0; i < 20; ++i) {
    const Medium medium(grid, test::random_affine(rng), 0.3, dvec3(1), 0);
    const dvec3 d = test::random_direction(rng), target = medium.to_world(test::random_point(rng, dvec3(6), dvec3(20)));
    const Ray local = medium.to_local(Ray{target - 50.0 * d, d});
    double sum = 0;
    const int n = 400000;
    for (int k = 0; k < n; ++k) sum += medium.sigma_t(local.at((k + 0.5) * 100.0 / n)) * 100.0 / n;
    EXPECT_NEAR(optical_depth(medium, local, kFar), sum, 1e-4 * (1 + sum));
  }
}

struct Case {
  double sigma_t, length;
};

// Means within 4.5 standard errors at 400000 walks: for tau = 1 a bias of 0.4 % of ratio tracking would be found.
TEST(RatioTracking, MeanIsBeerLambert) {
  const BrickGrid grid = ramp();
  Rng rng(1);
  for (const Case& c : {Case{0.05, 30}, {0.3, 3}, {1, 12}, {0.2, 35}}) {
    const Medium medium(grid, dmat4(1.0), c.sigma_t, dvec3(1), 0);
    const Ray ray{medium.to_local(dvec3(1.5, 9.3, 11.1)), dvec3(1, 0, 0)};
    const double exact = std::exp(-optical_depth(medium, ray, c.length));
    RunningStatistics ratio, delta;
    TrackingCounters counters;
    for (int i = 0; i < 400000; ++i) {
      ratio.add(estimate_transmittance(medium, ray, c.length, rng, counters).x);
      delta.add(sample_collision(medium, ray, c.length, 0, rng, counters).t < 0 ? 1.0 : 0.0);
    }
    EXPECT_NEAR(ratio.mean, exact, 4.5 * std::sqrt(ratio.mean_variance()));
    EXPECT_NEAR(delta.mean, exact, 4.5 * std::sqrt(exact * (1 - exact) / 400000));
    EXPECT_EQ(counters.majorant_violations, 0u);
  }
}

// One majorant over the whole segment: E[w^2] = exp(-int (2 sigma_t - sigma_t^2 / m)), the closed form for ratio
// tracking.
TEST(RatioTracking, VarianceIsTheClosedForm) {
  const BrickGrid grid =
      test::make_bricks({{1, 0, 0}, {6, 7, 7}}, [](const ivec3& v) { return v.x == 6 ? 1.0f : 0.4f; });
  const Medium medium(grid, dmat4(1.0), 0.25, dvec3(1), 0);
  const double length =
      3;  // within one cell and one constant stretch, sigma_t = 0.1, majorant 0.25: weights stay above roulette mostly
  const Ray ray{medium.to_local(dvec3(1.5, 3, 3)), dvec3(1, 0, 0)};
  RunningStatistics s;
  Rng rng(2);
  TrackingCounters counters;
  const int n = 1000000;
  double fourth = 0;
  const double mean = std::exp(-0.1 * length);
  for (int i = 0; i < n; ++i) {
    const double w = estimate_transmittance(medium, ray, length, rng, counters).x;
    s.add(w);
    fourth += std::pow(w - mean, 4) / n;
  }
  const double variance = std::exp(-length * (2 * 0.1 - 0.1 * 0.1 / 0.25)) - mean * mean;
  EXPECT_NEAR(s.sample_variance(), variance, 4.5 * std::sqrt((fourth - variance * variance) / n));
}

// Kolmogorov-Smirnov against 1 - exp(-tau(t)) with 100000 flights at level 1e-4 (2.23 / sqrt(n)): any error of the
// distribution function above 0.7 % would be found.
TEST(DeltaTracking, FreeFlightsFollowTheirDistribution) {
  const BrickGrid grid = ramp();
  const Medium medium(grid, dmat4(1.0), 0.15, dvec3(1), 0);
  const Ray ray{medium.to_local(dvec3(0.5, 10.4, 8.2)), dvec3(1, 0, 0)};
  Rng rng(4);
  TrackingCounters counters;
  std::vector<double> cdf;
  const int n = 100000;
  for (int i = 0; i < n; ++i) {
    const double t = sample_collision(medium, ray, kFar, 0, rng, counters).t;
    cdf.push_back(t < 0 ? 1.0 : 1 - std::exp(-0.15 * (0.2 * t + 0.025 * ((t + 0.5) * (t + 0.5) - 0.25))));
  }
  std::sort(cdf.begin(), cdf.end());
  const double escape = 1 - std::exp(-optical_depth(medium, ray, kFar));
  double worst = 0;
  for (int i = 0; i < n; ++i)
    if (cdf[static_cast<size_t>(i)] < 0.98 * escape)
      worst = std::max(worst, std::abs(cdf[static_cast<size_t>(i)] - (i + 0.5) / n));
  EXPECT_LT(worst, 2.23 / std::sqrt(n));
}

// A constant volume is the analytic homogeneous medium, whatever the transform: chord of a box, 1e5 rays' mean.
TEST(Tracking, AConstantVolumeIsTheHomogeneousMedium) {
  const BrickGrid grid = test::constant_box({0, 0, 0}, {30, 30, 30});
  Rng rng(6);
  for (int i = 0; i < 6; ++i) {
    const Medium medium(grid, test::random_affine(rng), 0.2, dvec3(1), 0);
    const dvec3 a = medium.to_world(dvec3(9, 20, 15)), b = medium.to_world(dvec3(28, 12, 22));
    const double length = glm::distance(a, b), exact = std::exp(-0.2 * length);
    const Ray local = medium.to_local(Ray{a, (b - a) / length});
    RunningStatistics s;
    TrackingCounters counters;
    for (int k = 0; k < 100000; ++k) s.add(estimate_transmittance(medium, local, length, rng, counters).x);
    EXPECT_NEAR(s.mean, exact, 4.5 * std::sqrt(s.mean_variance()) + 1e-6 * exact);
  }
}

TEST(Tracking, HardCasesEndFinite) {
  const BrickGrid grid = ramp();
  Rng rng(7);
  TrackingCounters counters;
  for (const double sigma_t : {1e-8, 1e6})
    for (const double scale : {1e-6, 1.0, 1e6})
      for (const dvec3& shift : {dvec3(0), dvec3(1e6)}) {
        const Medium medium(grid, test::translation(shift) * test::scaling(dvec3(scale)), sigma_t / scale, dvec3(1), 0);
        for (const dvec3& d : {dvec3(1, 0, 0), dvec3(0, -1, 0), glm::normalize(dvec3(1, 1, 1e-12))}) {
          const Ray ray = medium.to_local(Ray{medium.to_world(dvec3(20, 10, 10)) - d * (100 * scale), d});
          const double t = sample_collision(medium, ray, kFar, 0, rng, counters).t,
                       w = estimate_transmittance(medium, ray, kFar, rng, counters).x;
          EXPECT_TRUE(std::isfinite(t) && std::isfinite(w));
          EXPECT_GE(w, 0);
          EXPECT_LE(w, 1);
          EXPECT_EQ(t > 0, sigma_t > 1) << "a medium of density 1e6 stops every ray, one of 1e-8 none";
        }
      }
  EXPECT_EQ(counters.majorant_violations, 0u);
}

}  // namespace
}  // namespace brume
