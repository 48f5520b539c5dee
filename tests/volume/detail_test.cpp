// Noise below the voxel (volume/detail.h) against a second evaluation of its definition, its bounds and moments, and
// what it does to a medium.

#include "volume/detail.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "base/running_statistics.h"
#include "tests/support/volumes.h"
#include "volume/detail_flow.h"
#include "volume/tracking.h"

namespace brume {
namespace {

/// The definition, in index space: lattice points by name, all 27 around a place asked for their weight.
double noise_at(const Detail& detail, const dvec3& local, uint32_t seed) {
  double sum = 0, shares = 0;
  for (int o = 0; o < detail.octaves(); ++o) shares += std::pow(0.5, o);
  for (int o = 0; o < detail.octaves(); ++o) {
    const double scale = std::pow(2.0, o);
    std::array<double, 3> at{}, shift{};
    for (int a = 0; a < 3; ++a) {
      double first = detail.offset()[a];
      for (int c = 0; c < 3; ++c) first += detail.matrix()[c][a] * local[c];
      at[static_cast<size_t>(a)] = first * scale + o * Detail::kApart[a];
      shift[static_cast<size_t>(a)] = detail.cell()[static_cast<size_t>(a)] * scale;
    }
    const auto fade = [](double distance) {
      const double d = std::abs(distance);
      return d < 1 ? 1 - d * d * (3 - 2 * d) : 0.0;
    };
    for (int k = 0; k < 27; ++k) {
      const std::array<int, 3> step{k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1};
      double weight = 1;
      std::array<uint32_t, 3> point{};
      for (size_t a = 0; a < 3; ++a) {
        const double nearest = std::round(at[a]) + step[a];
        weight *= fade(at[a] - nearest);
        point[a] = static_cast<uint32_t>(static_cast<int64_t>(nearest + shift[a]));
      }
      const uint64_t mixed = Detail::hash(point[0], point[1], point[2], seed + static_cast<uint32_t>(o) * 0x27d4eb2fu);
      sum += std::pow(0.5, o) / shares * weight * (mixed < 0x80000000u ? 1 : -1);
    }
  }
  return sum;
}

TEST(Detail, IsAsDefined) {
  Rng rng(4);
  for (const Detail::Settings& s :
       {Detail::Settings{1, 1, 1, 0}, {0.5, 0.3, 3, 7}, {0.9, 2.5, 8, -1}, {0.2, 1, 4, 1}}) {
    const Detail detail(s, {-40, 1000, 3});
    for (int i = 0; i < 2000; ++i) {
      const dvec3 p = test::random_point(rng, dvec3(-30), dvec3(300));
      ASSERT_NEAR(detail.factor(p), 1 + s.amplitude * noise_at(detail, p, detail.phase(0).seed), 1e-9);
    }
  }
}

// A tenth of the amplitude would be found missing in the deviation, a two-hundredth in the mean.
TEST(Detail, HasAMeanOfOneAndFillsItsBounds) {
  Rng rng(5);
  for (const int octaves : {1, 3}) {
    const Detail detail({1, 1.3, octaves, 3}, ivec3(0));
    RunningStatistics values;
    double least = 2, most = 0;
    for (int i = 0; i < 1000000; ++i) {
      const double f = detail.factor(test::random_point(rng, dvec3(0), dvec3(2000)));
      values.add(f);
      least = std::min(least, f);
      most = std::max(most, f);
      ASSERT_GE(f, -1e-12);
      ASSERT_LE(f, detail.greatest() + 1e-12);
    }
    EXPECT_NEAR(values.mean, 1, 0.004);
    // Of one octave, along each axis: the integral of f^2 + (1 - f)^2 is 26 / 35.
    double squares = 0;
    for (int o = 0; o < octaves; ++o) squares += detail.weight(o) * detail.weight(o);
    EXPECT_NEAR(std::sqrt(values.sample_variance()), std::sqrt(squares) * std::pow(26.0 / 35, 1.5), 0.01);
    EXPECT_LT(least, 0.05);
    EXPECT_GT(most, 1.95);
  }
}

TEST(Detail, BelongsToIndexSpaceAndRepeatsNowhereNear) {
  const Detail::Settings s{0.8, 1.7, 4, 9};
  const ivec3 origin(-123, 45, 100000);
  const Detail here(s, ivec3(0)), there(s, origin);
  Rng rng(6);
  double apart = 0;
  for (int i = 0; i < 1000; ++i) {
    const dvec3 p = test::random_point(rng, dvec3(-200), dvec3(200));
    EXPECT_NEAR(there.factor(p - dvec3(origin)), here.factor(p), 1e-6);
    apart += std::abs(here.factor(p + dvec3(1024, 0, 0)) - here.factor(p));
    EXPECT_NE(here.factor(p), Detail({0.8, 1.7, 4, 10}, ivec3(0)).factor(p));
  }
  EXPECT_GT(apart / 1000, 0.2);
}

// Steps of a hundredth of the finest lattice change it by no more than its slope allows.
TEST(Detail, IsSmoothWhereItsFinestLatticeIs) {
  const Detail detail({1, 1, 3, 2}, ivec3(0));
  Rng rng(7);
  const double step = 0.01 / detail.finest();
  for (int i = 0; i < 20000; ++i) {
    const dvec3 p = test::random_point(rng, dvec3(0), dvec3(100)), d = test::random_direction(rng);
    ASSERT_LT(std::abs(detail.factor(p + step * d) - detail.factor(p)), 0.03);
  }
}

TEST(Detail, IsCarriedAlongAVelocityWithoutPulsating) {
  const BrickGrid one = test::constant_box(ivec3(-50), ivec3(50));
  Displacement flow;
  for (size_t a = 0; a < 3; ++a)
    flow.field.parts[a] = test::constant_box(ivec3(-60), ivec3(60), a == 0 ? 0.75f : a == 1 ? -0.5f : 0.25f);
  flow.origin_shift = dvec3(one.origin() - flow.field.parts[0].origin());
  const DetailFlow carrying(flow, one, {});
  const dvec3 velocity(0.75, -0.5, 0.25);
  Rng rng(8);
  for (const double frame : {-3.0, 0.0, 0.4, 5.0, 11.9, 12.0, 1001.5}) {
    Detail detail({0.8, 0.7, 3, 4}, one.origin());
    detail.carry(carrying, frame);
    double sum = 0, squares = 0;
    for (int i = 0; i < detail.phases(); ++i) {
      sum += detail.phase(i).weight;
      squares += detail.phase(i).weight * detail.phase(i).weight;
    }
    EXPECT_NEAR(sum, 1, 1e-12);
    EXPECT_NEAR(squares, 0.5, 1e-12);
    // A hundredth of a frame later all of it has moved on, and the weights hardly changed.
    Detail later({0.8, 0.7, 3, 4}, one.origin());
    later.carry(carrying, frame + 0.01);
    for (int i = 0; i < 300; ++i) {
      const dvec3 p = test::random_point(rng, dvec3(20), dvec3(70));
      double expected = 0;
      for (int k = 0; k < detail.phases(); ++k)
        expected +=
            detail.phase(k).weight * noise_at(detail, p - detail.phase(k).since * velocity, detail.phase(k).seed);
      ASSERT_NEAR(detail.factor(p), 1 + 0.8 * expected, 1e-6);
      ASSERT_NEAR(later.factor(p + 0.01 * velocity), detail.factor(p), 0.012);
    }
  }
}

// A whirl, a turn of which takes 12 frames: between points two voxels apart it is linear but for 1 / 1024 of the
// largest.
TEST(DetailFlow, IsTheVelocityToAThousandth) {
  const VoxelBox box{ivec3(0), ivec3(47)};
  const auto whirl = [](const ivec3& v, size_t axis) {
    const double x = v.x - 24.0, y = v.y - 24.0;
    return static_cast<float>(axis == 0 ? -0.5 * y : axis == 1 ? 0.5 * x : 0.0);
  };
  const BrickGrid density = test::make_bricks(box, [](const ivec3& v) { return v.z < 24 ? 1.0f : 0.0f; });
  Displacement velocity;
  for (size_t a = 0; a < 3; ++a)
    velocity.field.parts[a] = test::make_bricks({ivec3(-8), ivec3(63)}, [&](const ivec3& v) { return whirl(v, a); });
  velocity.origin_shift = dvec3(density.origin() - velocity.field.parts[0].origin());
  const DetailFlow flow(velocity, density, {});
  EXPECT_EQ(flow.spacing, 2);
  Rng rng(12);
  for (int i = 0; i < 20000; ++i) {
    const dvec3 p = test::random_point(rng, dvec3(2), dvec3(46, 46, 22));
    const dvec3 v = velocity.field.lookup(p + velocity.origin_shift);
    ASSERT_LT(glm::length(flow.lookup(p) - v), 14.0 / 511);
  }
}

/// A medium of voxels unlike each other, a third of them 0.
struct Rough {
  BrickGrid grid = test::make_bricks({{0, 0, 0}, {40, 30, 30}}, [](const ivec3& v) {
    return v.x > 12 && v.x < 26 ? 0.0f : static_cast<float>((v.x * 7 + v.y * 3 + v.z * 5) % 11) / 11.0f;
  });
  Detail detail{{0.9, 0.8, 3, 5}, grid.origin()};
  Medium medium(double sigma_t, const dmat4& place = dmat4(1.0)) const {
    Medium m(grid, place, sigma_t, dvec3(1), 0);
    m.set_detail(detail);
    return m;
  }
};

TEST(MediumWithDetail, NeverExceedsItsMajorantsAndIsEmptyWhereItWas) {
  const Rough rough;
  Rng rng(9);
  const Medium medium = rough.medium(1, test::random_affine(rng));
  const auto [lo, hi] = medium.support();
  double closest = 0;
  for (int i = 0; i < 1000000; ++i) {
    const dvec3 p = test::random_point(rng, lo, hi);
    const BrickGrid::Cell& cell = rough.grid.cell(ivec3(p) / rough.grid.cell_size());
    const double density = medium.density(p);
    ASSERT_LE(density, cell.majorant * medium.majorant_factor() * kMajorantMargin);
    ASSERT_LE(density, medium.maximum_density() * kMajorantMargin);
    ASSERT_EQ(medium.smooth_density(p) == 0, density == 0 && medium.smooth_density(p) == 0);
    closest = std::max(closest, density / medium.maximum_density());
  }
  EXPECT_GT(closest, 0.8);
}

TEST(MediumWithDetail, HasTheOpticalDepthOfItsDensity) {
  const Rough rough;
  Rng rng(10);
  for (int i = 0; i < 10; ++i) {
    const Medium medium = rough.medium(0.3, test::random_affine(rng));
    const dvec3 d = test::random_direction(rng), target = medium.to_world(test::random_point(rng, dvec3(6), dvec3(24)));
    const Ray local = medium.to_local(Ray{target - 60.0 * d, d});
    double sum = 0;
    const int n = 200000;
    for (int k = 0; k < n; ++k) sum += medium.sigma_t(local.at((k + 0.5) * 120.0 / n)) * 120.0 / n;
    EXPECT_NEAR(optical_depth(medium, local, kUnbounded), sum, 2e-3 * (1 + sum));
  }
}

// Means within 4.5 standard errors at 300000 walks.
TEST(MediumWithDetail, IsTrackedWithoutBias) {
  const Rough rough;
  for (const double sigma_t : {0.1, 0.6}) {
    Medium medium = rough.medium(sigma_t);
    const Ray ray{medium.to_local(dvec3(-3, 9.3, 11.1)), glm::normalize(dvec3(1, 0.1, 0.2))};
    const double exact = std::exp(-optical_depth(medium, ray, kUnbounded));
    for (const bool global : {false, true}) {
      medium.set_majorants(1, global);
      Rng rng(11);
      RunningStatistics ratio, delta;
      TrackingCounters counters;
      for (int i = 0; i < 300000; ++i) {
        ratio.add(estimate_transmittance(medium, ray, kUnbounded, rng, counters).x);
        delta.add(sample_collision(medium, ray, kUnbounded, 0, rng, counters).t < 0);
      }
      EXPECT_NEAR(ratio.mean, exact, 4.5 * std::sqrt(ratio.mean_variance()));
      EXPECT_NEAR(delta.mean, exact, 4.5 * std::sqrt(delta.mean_variance()));
      EXPECT_EQ(counters.majorant_violations, 0u);
    }
  }
}

}  // namespace
}  // namespace brume
