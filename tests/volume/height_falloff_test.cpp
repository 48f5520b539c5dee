// Fog that falls off with height: integrals and free flights in closed form, against quadrature.

#include "volume/height_falloff.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/math.h"
#include "base/rng.h"
#include "volume/tracking.h"

namespace brume {
namespace {

/// By Simpson's rule between the points where a ray crosses the plane below which the density is 1.
double quadrature(const HeightFalloff& fog, const Ray& ray, double t0, double t1) {
  std::vector<double> ends{t0, t1};
  const double climb = glm::dot(fog.slope, ray.d), crosses = climb != 0 ? -fog.height(ray.o) / climb : t0;
  if (crosses > t0 && crosses < t1) ends.insert(ends.begin() + 1, crosses);
  double sum = 0;
  for (size_t k = 1; k < ends.size(); ++k) {
    constexpr int kSteps = 20000;
    const double h = (ends[k] - ends[k - 1]) / kSteps;
    for (int i = 0; i <= kSteps; ++i)
      sum += (i == 0 || i == kSteps ? 1 : i % 2 ? 4 : 2) * fog.density(ray.at(ends[k - 1] + i * h)) * h / 3;
  }
  return sum;
}

const double kAngles[] = {90, 60, 30, 5, 0.3, 1e-3, 1e-6, 1e-10, 1e-15, 0, -1e-14, -1e-8, -1e-4, -0.2, -10, -45, -90};

Ray ray_at(double height, double angle) {
  const double a = angle * kPi / 180;
  return {{3, -2, height}, {std::cos(a), 0, std::sin(a)}};
}

TEST(HeightFalloff, IntegralsAreExactAtAllAngles) {
  const HeightFalloff fog{{0, 0, 1 / 2.5}, 1 / 2.5};  // a base at 1, a scale of 2.5
  for (const double height : {-7.0, 0.999, 1.0, 1.5, 6.0, 30.0})
    for (const double angle : kAngles)
      for (const double length : {1e-6, 0.3, 20.0}) {
        const Ray ray = ray_at(height, angle);
        const double expected = quadrature(fog, ray, 0.1, 0.1 + length);
        EXPECT_NEAR(fog.integral(ray, 0.1, 0.1 + length), expected, 2e-9 * expected)
            << height << " " << angle << " " << length;
      }
}

// Where it is said to have reached a value it has that value, to rounding, and nowhere does it reach what is more than
// there is.
TEST(HeightFalloff, ReachesWhatItsIntegralIs) {
  const HeightFalloff fog{{0, 0, 1 / 2.5}, 1 / 2.5};
  for (const double height : {-7.0, 0.999, 1.0, 1.5, 6.0, 30.0, 3000.0})
    for (const double angle : kAngles)
      for (const double value : {1e-12, 1e-3, 0.7, 5.0, 300.0}) {
        const Ray ray = ray_at(height, angle);
        const double t = fog.reaches(ray, 2, value);
        if (std::isfinite(t)) {
          ASSERT_GE(t, 2);
          // Far away t itself is rounded, by what that is worth in the density there.
          const double rounding = 4e-16 * std::max(1.0, t) * fog.density(ray.at(t));
          EXPECT_NEAR(fog.integral(ray, 2, t), value, 1e-9 * value + rounding) << height << " " << angle;
        } else {
          EXPECT_LT(fog.integral(ray, 2, 1e7), value) << height << " " << angle;
        }
      }
}

TEST(HeightFalloff, EndsFiniteWhereTheDensityUnderflows) {
  const HeightFalloff fog{{0, 0, 1e3}, 0};
  EXPECT_EQ(fog.density({0, 0, 5}), 0);
  EXPECT_EQ(fog.integral({{0, 0, 5}, {1, 0, 0}}, 0, 1e9), 0);
  EXPECT_EQ(fog.reaches({{0, 0, 5}, {1, 0, 0}}, 0, 1e-3), kUnbounded);
  EXPECT_EQ(fog.reaches({{0, 0, 5}, {0, 0, 1}}, 0, 1e-3), kUnbounded);
  // From where it is nothing down to where it is full.
  EXPECT_NEAR(fog.reaches({{0, 0, 5}, {0, 0, -1}}, 0, 1.001), 6.0, 1e-12);
  EXPECT_NEAR(fog.integral({{0, 0, 5}, {0, 0, -1}}, 0, 6), 1.001, 1e-12);
}

/// A layer that is turned and stretched.
Medium layer(const dvec3& sigma_t) {
  HomogeneousShape shape{HomogeneousShape::Shape::kBox, {-5, -5, -1}, {5, 5, 6}};
  shape.falloff = HeightFalloff{{0.1, 0, 0.9}, 0.2};
  dmat4 place(dmat3(0.8, 0.6, 0, -0.6, 0.8, 0.1, 0, 0.2, 1.3));
  place[3] = glm::dvec4(2, -1, 0.5, 1);
  return {shape, place, {sigma_t, dvec3(1)}, PhaseFunction::henyey_greenstein(0)};
}

// Transmittance in closed form against delta tracking's, which looks up densities alone: 40000 flights along each of 8
// rays; a difference of 0.01 would be found.
TEST(HeightFalloff, MediaAreWhatDeltaTrackingFindsInThem) {
  const Medium medium = layer(dvec3(0.7));
  Rng rng(3);
  TrackingCounters counters;
  for (int i = 0; i < 8; ++i) {
    const dvec3 a{8 * rng.uniform() - 4, 8 * rng.uniform() - 4, 8 * rng.uniform() - 2};
    const dvec3 b{8 * rng.uniform() - 4, 8 * rng.uniform() - 4, 8 * rng.uniform() - 2};
    const double length = glm::distance(a, b);
    const Ray local = medium.to_local(Ray{a, (b - a) / length});
    constexpr int kFlights = 40000;
    int passed = 0;
    for (int k = 0; k < kFlights; ++k) passed += sample_collision(medium, local, length, 0, rng, counters).t < 0;
    const double expected = estimate_transmittance(medium, local, length, rng, counters).x;
    EXPECT_NEAR(passed / double{kFlights}, expected, 4 * std::sqrt(0.25 / kFlights)) << i;
    EXPECT_NEAR(std::exp(-optical_depth(medium, local, length)), expected, 1e-12);
  }
  EXPECT_EQ(counters.majorant_violations, 0u);
}

// Chi-square of free flights that invert the closed form: 40 parts of equal probability by the density's own integral,
// found by quadrature; 40000 flights at each of four angles, level 1e-5.
TEST(HeightFalloff, FlightsFollowTheirDistribution) {
  const HeightFalloff fog{{0, 0, 0.8}, -0.4};
  Rng rng(9);
  for (const double angle : {40.0, 1e-7, -3.0, -60.0}) {
    const Ray ray = ray_at(1.1, angle);
    constexpr int kParts = 40, kFlights = 40000, kCells = 4000;
    const double end = 60, sigma = 0.9;
    std::vector<double> depth{0};
    for (int i = 0; i < kCells; ++i)
      depth.push_back(depth.back() +
                      sigma * end / kCells / 6 *
                          (fog.density(ray.at(end * i / kCells)) + 4 * fog.density(ray.at(end * (i + 0.5) / kCells)) +
                           fog.density(ray.at(end * (i + 1) / kCells))));
    std::vector<int> count(kParts);
    for (int k = 0; k < kFlights; ++k) {
      const double t = fog.reaches(ray, 0, rng.exponential() / sigma);
      double passed = std::exp(-depth.back());  // where it goes beyond the end
      if (t < end) {
        const double at = t / end * kCells;
        const auto i = std::min(static_cast<size_t>(at), static_cast<size_t>(kCells - 1));
        passed = std::exp(-depth[i] - (at - static_cast<double>(i)) * (depth[i + 1] - depth[i]));
      } else {
        passed *= rng.uniform();
      }
      ++count[static_cast<size_t>(std::min(kParts - 1.0, kParts * (1 - passed)))];
    }
    double chi2 = 0;
    const double expected = kFlights / double{kParts};
    for (const int n : count) chi2 += (n - expected) * (n - expected) / expected;
    EXPECT_LT(chi2, kParts - 1 + 4.6 * std::sqrt(2.0 * (kParts - 1))) << angle;
  }
}

}  // namespace
}  // namespace brume
