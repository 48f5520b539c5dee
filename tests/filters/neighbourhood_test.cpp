// What filters are built from, against definitions written out in double.

#include "filters/patch/neighbourhood.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "base/rng.h"
#include "filters/inputs/features.h"
#include "filters/inputs/noise.h"
#include "filters/kernels/histogram.h"
#include "filters/kernels/regression.h"
#include "filters/patch/picture_noise.h"
#include "filters/patch/student.h"
#include "filters/per_sample/mutual_information.h"
#include "filters/regression/guided_filter.h"
#include "filters/regression/regression.h"
#include "tests/support/frames.h"
#include "tests/support/targets.h"

namespace brume {
namespace {

using test::chance;
using test::normal;

using test::EveryTarget;
INSTANTIATE_TEST_SUITE_P(Isa, EveryTarget, ::testing::ValuesIn(test::targets()), test::target_name);

Plane plane_of(int width, int height, const std::function<double(int, int)>& value) {
  Plane p(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) p(x, y) = static_cast<float>(value(x, y));
  return p;
}

std::vector<Plane> noise_planes(int width, int height, uint64_t seed, double scale = 1) {
  std::vector<Plane> planes;
  for (uint64_t c = 0; c < 3; ++c)
    planes.push_back(plane_of(width, height, [&](int x, int y) { return scale * chance(x, y, 10 * seed + c); }));
  return planes;
}

/// The weights of docs/methods.md, Patch distances, with borders as stated there: the mean over the patch pixels that
/// are inside at both ends.
double nl_means_weight(const std::vector<Plane>& u, const std::vector<Plane>& v, int px, int py, int qx, int qy, int f,
                       double k) {
  const int width = u[0].width(), height = u[0].height();
  double sum = 0;
  int n = 0;
  for (int j = -f; j <= f; ++j)
    for (int i = -f; i <= f; ++i) {
      const int ax = px + i, ay = py + j, bx = qx + i, by = qy + j;
      if (ax < 0 || ay < 0 || bx < 0 || by < 0 || ax >= width || bx >= width || ay >= height || by >= height) continue;
      for (size_t c = 0; c < 3; ++c) {
        const double d = static_cast<double>(u[c](ax, ay)) - u[c](bx, by), va = v[c](ax, ay), vb = v[c](bx, by);
        sum += (d * d - (va + std::min(va, vb))) / (1e-10 + k * k * (va + vb)) / 3;
      }
      ++n;
    }
  return std::exp(-std::max(0.0, sum / n));
}

TEST_P(EveryTarget, NonLocalMeansIsItsDefinition) {
  const int width = 37, height = 21, r = 4;
  const std::vector<Plane> u = noise_planes(width, height, 1), v = noise_planes(width, height, 2, 0.05);
  for (const int f : {0, 1, 2, 3}) {
    WeightModel model;
    model.distances.push_back(noise_distance(pointers(u), pointers(v), f, 0.7f));
    const Averages a = weighted_average(model, square_window(r), pointers(u), {});
    for (int y = 0; y < height; y += 3)
      for (int x = 0; x < width; x += 2) {
        double sum = 0, total = 0;
        for (int qy = std::max(0, y - r); qy <= std::min(height - 1, y + r); ++qy)
          for (int qx = std::max(0, x - r); qx <= std::min(width - 1, x + r); ++qx) {
            const double w = nl_means_weight(u, v, x, y, qx, qy, f, 0.7);
            sum += w * u[1](qx, qy);
            total += w;
          }
        ASSERT_NEAR(a.values[1](x, y), sum / total, 2e-5) << f << ": " << x << " " << y;
        ASSERT_NEAR(a.weight(x, y), total, 2e-5 * total);
      }
  }
}

TEST_P(EveryTarget, ManySystemsAreSolvedAsOneByOne) {
  constexpr int n = 7, m = 3, count = 50;
  constexpr size_t stride = 64;
  std::vector<float> a(stride * n * (n + 1) / 2), b(stride * n * m);
  std::vector<Eigen::MatrixXd> matrices, sides;
  for (int x = 0; x < count; ++x) {
    Eigen::MatrixXd root(n, n + 3), side(n, m);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n + 3; ++j) root(i, j) = chance(x, i, static_cast<uint64_t>(j)) - 0.5;
    for (int i = 0; i < n; ++i)
      for (int c = 0; c < m; ++c) side(i, c) = chance(x, i, static_cast<uint64_t>(100 + c));
    matrices.push_back(root * root.transpose() + 0.05 * Eigen::MatrixXd::Identity(n, n));
    sides.push_back(side);
    for (int i = 0; i < n; ++i) {
      for (int j = i; j < n; ++j)
        a[stride * static_cast<size_t>(kernels::triangle(i, j, n)) + static_cast<size_t>(x)] =
            static_cast<float>(matrices.back()(i, j));
      for (int c = 0; c < m; ++c)
        b[stride * static_cast<size_t>(i * m + c) + static_cast<size_t>(x)] = static_cast<float>(side(i, c));
    }
  }
  kernels::solve_rows(a.data(), b.data(), n, m, count, stride, 0, 0);
  for (int x = 0; x < count; ++x) {
    const Eigen::MatrixXd solution = matrices[static_cast<size_t>(x)].ldlt().solve(sides[static_cast<size_t>(x)]);
    for (int i = 0; i < n; ++i)
      for (int c = 0; c < m; ++c)
        ASSERT_NEAR(b[stride * static_cast<size_t>(i * m + c) + static_cast<size_t>(x)], solution(i, c),
                    1e-3 * (1 + solution.cwiseAbs().maxCoeff()));
  }
}

TEST_P(EveryTarget, AColumnOfZerosHasNoCoefficient) {
  std::vector<float> a = {2, 0, 0}, b = {3, 0};  // one system of two unknowns, the second regressor zero
  std::vector<float> wide_a(3 * 16), wide_b(2 * 16);
  for (size_t i = 0; i < 3; ++i) wide_a[16 * i] = a[i];
  for (size_t i = 0; i < 2; ++i) wide_b[16 * i] = b[i];
  kernels::solve_rows(wide_a.data(), wide_b.data(), 2, 1, 1, 16, 1e-6f, 1e-7f);
  EXPECT_NEAR(wide_b[0], 1.5f, 1e-5f);
  EXPECT_EQ(wide_b[16], 0.0f);
}

TEST_P(EveryTarget, HistogramDistanceIsChiSquareOfTheFullBins) {
  constexpr int bins = 12, count = 21;
  constexpr size_t stride = 32;
  std::vector<float> h1(bins * stride), h2(bins * stride), n1(stride), n2(stride), sum(stride), counted(stride);
  for (int x = 0; x < count; ++x) {
    n1[static_cast<size_t>(x)] = static_cast<float>(8 + x % 3 * 8);
    n2[static_cast<size_t>(x)] = 16;
    for (int b = 0; b < bins; ++b) {
      h1[static_cast<size_t>(b) * stride + static_cast<size_t>(x)] = static_cast<float>(2 * chance(x, b, 1));
      h2[static_cast<size_t>(b) * stride + static_cast<size_t>(x)] = static_cast<float>(2 * chance(x, b, 2));
    }
  }
  kernels::histogram_distance_row(h1.data(), h2.data(), n1.data(), n2.data(), bins, stride, count, sum.data(),
                                  counted.data());
  for (size_t x = 0; x < count; ++x) {
    double expected = 0;
    int used = 0;
    for (size_t b = 0; b < bins; ++b) {
      const double p = h1[b * stride + x], q = h2[b * stride + x], a = n1[x], c = n2[x];
      if (p + q > 1) {
        expected += (c * p - a * q) * (c * p - a * q) / (a * c * (p + q));
        ++used;
      }
    }
    ASSERT_NEAR(sum[x], expected, 1e-4 * (1 + expected));
    ASSERT_EQ(counted[x], static_cast<float>(used));
  }
}

TEST(Neighbourhood, NoNoiseAndNoEqualsIsIdentity) {
  const std::vector<Plane> u = noise_planes(30, 20, 3), v(3, plane_of(30, 20, [](int, int) { return 1e-12; }));
  WeightModel model;
  model.distances.push_back(noise_distance(pointers(u), pointers(v), 1, 0.45f));
  const Averages a = weighted_average(model, square_window(5), pointers(u), {});
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 30; ++x) EXPECT_EQ(a.values[0](x, y), u[0](x, y));
}

TEST(Neighbourhood, VariantsShareDistancesAndReportTheNoiseThatIsLeft) {
  const std::vector<Plane> u = noise_planes(40, 30, 4);
  const Plane v = plane_of(40, 30, [](int, int) { return 0.3; });
  const std::vector<Offset> window = gaussian_window(3, 1.5);
  std::vector<Variant> variants(2);
  variants[1].scale = 0;
  const auto both = weighted_averages({}, window, variants, pointers(u), &v, {});
  const auto plain = weighted_average({}, window, pointers(u), {});
  double sum = 0, squares = 0;
  for (const Offset& o : window) {
    sum += o.weight;
    squares += o.weight * o.weight;
  }
  EXPECT_NEAR(both[0].noise(20, 15), 0.3 * squares / (sum * sum), 1e-6);
  EXPECT_EQ(both[0].values[2](20, 15), plain.values[2](20, 15));
  EXPECT_EQ(both[1].values[2](3, 7), plain.values[2](3, 7)) << "without distances the scale is nothing";
}

TEST(Neighbourhood, MembershipAndTrustLeaveNeighboursOut) {
  const Plane u = plane_of(9, 1, [](int x, int) { return x == 4 ? 0.0 : x == 5 ? 0.9 : x == 3 ? 1.1 : 50.0; });
  const Plane bound = plane_of(9, 1, [](int, int) { return 1.0; });
  const Plane trust = plane_of(9, 1, [](int x, int) { return x == 5 ? 0.5 : 1.0; });
  WeightModel model;
  model.memberships.push_back({Membership::Bound::kOwn, {&u}, {&u}, {&bound}, {}});
  const Plane* values[] = {&u};
  // Of the neighbours of pixel 4 only pixel 5 lies within 1.
  EXPECT_NEAR(weighted_average(model, square_window(1), values, {}).values[0](4, 0), 0.45, 1e-6);
  model.trust = &trust;
  EXPECT_NEAR(weighted_average(model, square_window(1), values, {}).values[0](4, 0), 0.9 * 0.5 / 1.5, 1e-6);
}

// The guided filter.

Plane box_of_box(const Plane& in, int r) {
  return box_mean(box_mean(in, r, {}), r, {});
}

TEST(GuidedFilter, ReproducesWhatIsLinearInTheGuide) {
  const std::vector<Plane> guide = noise_planes(33, 27, 5);
  const Plane in = plane_of(33, 27, [&](int x, int y) { return 3 * guide[0](x, y) - 2 * guide[2](x, y) + 5; });
  const Plane* inputs[] = {&in};
  const std::vector<Plane> out = guided_filter(inputs, pointers(guide), 3, 1e-7f, {});
  for (int y = 0; y < 27; ++y)
    for (int x = 0; x < 33; ++x) ASSERT_NEAR(out[0](x, y), in(x, y), 2e-4);
}

TEST(GuidedFilter, WithoutAGuideOrWithAllRidgeIsTwoBoxes) {
  const std::vector<Plane> guide = noise_planes(33, 27, 6), in = noise_planes(33, 27, 7);
  const Plane flat = plane_of(33, 27, [](int, int) { return 0.5; });
  const Plane* constant[] = {&flat};
  const Plane expected = box_of_box(in[1], 4);
  for (const auto& out :
       {guided_filter(pointers(in), pointers(guide), 4, 1e9f, {}), guided_filter(pointers(in), constant, 4, 1e-3f, {}),
        guided_filter(pointers(in), {}, 4, 1e-3f, {})})
    for (int y = 0; y < 27; ++y)
      for (int x = 0; x < 33; ++x) ASSERT_NEAR(out[1](x, y), expected(x, y), 1e-5);
}

TEST(GuidedFilter, MatchesRegressionsWrittenOut) {
  const int width = 19, height = 15, r = 2;
  const std::vector<Plane> guide = noise_planes(width, height, 8), in = noise_planes(width, height, 9);
  const std::vector<Plane> out = guided_filter(pointers(in), pointers(guide), r, 0.01f, {});
  const auto inside = [&](int x, int y) { return x >= 0 && y >= 0 && x < width && y < height; };
  const int cx = 1, cy = 7;  // beside an edge
  Eigen::Vector3d a_mean = Eigen::Vector3d::Zero();
  double b_mean = 0;
  int windows = 0;
  for (int ky = cy - r; ky <= cy + r; ++ky)
    for (int kx = cx - r; kx <= cx + r; ++kx) {
      if (!inside(kx, ky)) continue;
      Eigen::Vector3d mean = Eigen::Vector3d::Zero(), cross = mean;
      Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
      double p_mean = 0;
      int n = 0;
      for (int y = ky - r; y <= ky + r; ++y)
        for (int x = kx - r; x <= kx + r; ++x) {
          if (!inside(x, y)) continue;
          const Eigen::Vector3d g(guide[0](x, y), guide[1](x, y), guide[2](x, y));
          mean += g;
          squares += g * g.transpose();
          cross += g * static_cast<double>(in[0](x, y));
          p_mean += in[0](x, y);
          ++n;
        }
      mean /= n;
      squares /= n;
      cross /= n;
      p_mean /= n;
      const Eigen::Vector3d a =
          (squares - mean * mean.transpose() + 0.01 * Eigen::Matrix3d::Identity()).ldlt().solve(cross - mean * p_mean);
      a_mean += a;
      b_mean += p_mean - a.dot(mean);
      ++windows;
    }
  const Eigen::Vector3d g(guide[0](cx, cy), guide[1](cx, cy), guide[2](cx, cy));
  EXPECT_NEAR(out[0](cx, cy), a_mean.dot(g) / windows + b_mean / windows, 1e-5);
}

// Collaborative regression.

TEST_P(EveryTarget, CollaborativeRegressionReproducesAffinePicturesWhateverTheWeights) {
  const int width = 90, height = 50;
  const std::vector<Plane> f = noise_planes(width, height, 10);
  const Plane v =
      plane_of(width, height, [&](int x, int y) { return 0.7 + 0.02 * x - 0.05 * y + 2 * f[0](x, y) - f[1](x, y); });
  const Plane noise = plane_of(width, height, [&](int x, int y) { return 0.01 + chance(x, y, 3); });
  const Plane *values[] = {&v}, *features[] = {&f[0], &f[1]}, *guide[] = {&v}, *variance[] = {&noise};
  WeightModel model;
  model.distances.push_back(noise_distance(guide, variance, 1, 1));
  const std::vector<Plane> out = collaborative_regression(
      {{{model, {std::begin(features), std::end(features)}, {std::begin(values), std::end(values)}}}}, 5, {});
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) ASSERT_NEAR(out[0](x, y), v(x, y), 3e-4) << x << " " << y;
}

TEST_P(EveryTarget, CollaborativeRegressionMatchesLeastSquaresWrittenOut) {
  const int width = 16, height = 12, r = 2;
  const std::vector<Plane> f = noise_planes(width, height, 11), v = noise_planes(width, height, 12);
  const Plane noise = plane_of(width, height, [](int, int) { return 0.05; });
  const Plane *features[] = {&f[0]}, *values[] = {&v[0]}, *guide[] = {&f[1]}, *variance[] = {&noise};
  WeightModel model;
  model.distances.push_back(noise_distance(guide, variance, 0, 1));
  const std::vector<Plane> out = collaborative_regression(
      {{{model, {std::begin(features), std::end(features)}, {std::begin(values), std::end(values)}}}}, r, {});
  const auto weight = [&](int px, int py, int qx, int qy) {
    const double d = static_cast<double>(f[1](px, py)) - f[1](qx, qy);
    return std::exp(-std::max(0.0, (d * d - 0.1) / 0.1));
  };
  double sum = 0, total = 0;
  const int tx = 1, ty = 5;
  for (int py = std::max(0, ty - r); py <= ty + r; ++py)
    for (int px = std::max(0, tx - r); px <= tx + r; ++px) {
      Eigen::Matrix4d a = Eigen::Matrix4d::Zero();
      Eigen::Vector4d b = Eigen::Vector4d::Zero();
      const auto row = [&](int qx, int qy) {
        return Eigen::Vector4d(1, qx - px, qy - py, static_cast<double>(f[0](qx, qy)) - f[0](px, py));
      };
      for (int qy = std::max(0, py - r); qy <= std::min(height - 1, py + r); ++qy)
        for (int qx = std::max(0, px - r); qx <= std::min(width - 1, px + r); ++qx) {
          const double w = weight(px, py, qx, qy);
          a += w * row(qx, qy) * row(qx, qy).transpose();
          b += w * row(qx, qy) * static_cast<double>(v[0](qx, qy));
        }
      const double w = weight(px, py, tx, ty);
      sum += w * row(tx, ty).dot(a.ldlt().solve(b));
      total += w;
    }
  EXPECT_NEAR(out[0](tx, ty), sum / total, 1e-4);
}

// A sample hundreds of times as bright as the rest tilts every line that sees it, whose other end leads far below
// black.
TEST(CollaborativeRegression, StaysWithinTheValuesOfTheWindow) {
  const int width = 40, height = 30;
  const std::vector<Plane> f = noise_planes(width, height, 13);
  const Plane v =
      plane_of(width, height, [&](int x, int y) { return x == 20 && y == 15 ? 400.0 : 1 + 0.2 * chance(x, y, 4); });
  const Plane noise = plane_of(width, height, [](int, int) { return 1e5; });
  const Plane *values[] = {&v}, *features[] = {&f[0], &f[1]}, *guide[] = {&v}, *variance[] = {&noise};
  WeightModel model;
  model.distances.push_back(noise_distance(guide, variance, 1, 1));
  const std::vector<Plane> out = collaborative_regression(
      {{{model, {std::begin(features), std::end(features)}, {std::begin(values), std::end(values)}}}}, 5, {});
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      EXPECT_GE(out[0](x, y), 1.0f);
      EXPECT_LE(out[0](x, y), std::hypot(x - 20, y - 15) > 15 ? 1.2f : 400.0f);
    }
}

TEST(Regression, WindowExtremesAreThoseOfEveryWindow) {
  const Plane v = noise_planes(23, 17, 14)[0];
  for (const int r : {0, 1, 2, 3, 7, 8, 30}) {
    const Plane low = window_minimum(v, r, {}), high = window_maximum(v, r, {});
    for (int y = 0; y < 17; ++y)
      for (int x = 0; x < 23; ++x) {
        float a = v(x, y), b = v(x, y);
        for (int qy = std::max(0, y - r); qy <= std::min(16, y + r); ++qy)
          for (int qx = std::max(0, x - r); qx <= std::min(22, x + r); ++qx)
            a = std::min(a, v(qx, qy)), b = std::max(b, v(qx, qy));
        ASSERT_EQ(low(x, y), a) << r;
        ASSERT_EQ(high(x, y), b) << r;
      }
  }
}

// Statistics.

TEST(Student, QuantilesAreTheTables) {
  const double dof[] = {1, 2, 3, 7, 15, 31, 35, 63, 1e9};
  const double at_99[] = {63.657, 9.925, 5.841, 3.499, 2.947, 2.744, 2.724, 2.656, 2.576};
  const double at_998[] = {318.31, 22.327, 10.215, 4.785, 3.733, 3.375, 3.340, 3.225, 3.090};
  for (size_t i = 0; i < 9; ++i) {
    EXPECT_NEAR(student_quantile(0.99, dof[i]), at_99[i], 6e-4 * at_99[i] / 2.5);
    EXPECT_NEAR(student_quantile(0.998, dof[i]), at_998[i], 6e-4 * at_998[i] / 2.5);
  }
}

TEST(MutualInformation, FindsDependenceThatCorrelationMisses) {
  const size_t n = 2000;
  std::vector<float> r, c, other;
  Rng rng(5);
  for (size_t i = 0; i < n; ++i) {
    const double v = 3.14159 * (rng.uniform() - 0.5);
    r.push_back(static_cast<float>(v / 0.907));
    c.push_back(static_cast<float>((std::cos(v) - 0.6366) / 0.3078));
    other.push_back(static_cast<float>((rng.uniform() - 0.5) * 3.46));
  }
  MutualInformation mi(n);
  const size_t a = mi.add(r), b = mi.add(c), o = mi.add(other), constant = mi.add(std::vector<float>(n, 0.0f));
  EXPECT_GT(mi(a, b, true), 0.3);
  EXPECT_LT(mi(a, o, true), 0.01);
  EXPECT_EQ(mi(a, constant, false), 0.0);
  EXPECT_NEAR(mi(a, b, true), mi(b, a, true), 1e-12);
}

TEST(MutualInformation, OfIndependentColumnsHasTheStatedBias) {
  double sum = 0, corrected = 0;
  const int runs = 400;
  Rng rng(6);
  for (int i = 0; i < runs; ++i) {
    std::vector<float> x, y;
    for (int k = 0; k < 196; ++k) {
      x.push_back(static_cast<float>((rng.uniform() - 0.5) * 3.46));
      y.push_back(static_cast<float>((rng.uniform() - 0.5) * 3.46));
    }
    MutualInformation mi(196);
    const size_t a = mi.add(x), b = mi.add(y);
    sum += mi(a, b, false) / runs;
    corrected += mi(a, b, true) / runs;
  }
  // Uniform columns of deviation 1 fill five bins: 16 / 392 = 0.041 nats. Clamping at 0 leaves some of it.
  EXPECT_NEAR(sum, 0.041, 0.003);
  EXPECT_LT(corrected, 0.008);
}

// Noise.

TEST(Noise, LevelFollowsTheHalvesAndStructureTheSamples) {
  // Low-discrepancy samples: the variance layer is four times too large, the halves know.
  const int size = 120;
  Rgb mean, variance, a, b;
  for (size_t c = 0; c < 3; ++c) {
    mean[c] = plane_of(size, size, [](int, int) { return 0.5; });
    variance[c] = plane_of(size, size, [](int x, int) { return x < 60 ? 4e-4 : 16e-4; });
    const auto half = [&](double sign) {
      return plane_of(size, size,
                      [&](int x, int y) { return 0.5 + sign * (x < 60 ? 0.01 : 0.02) * normal(x, y, 7 + c); });
    };
    a[c] = half(1);
    b[c] = half(-1);
  }
  const Rgb v = corrected_variance(view(mean), view(variance), view(a), view(b), nullptr, {});
  EXPECT_NEAR(v[0](20, 60), 1e-4, 2e-5);
  EXPECT_NEAR(v[0](100, 60), 4e-4, 8e-5);
}

TEST(Noise, ASampleByItselfAndABlackPixelAreNotCertain) {
  const auto flat = [](double v) { return plane_of(9, 9, [v](int, int) { return v; }); };
  Rgb mean = {flat(1), flat(1), flat(1)}, variance = {flat(0.04), flat(0.04), flat(0.04)};
  for (size_t c = 0; c < 3; ++c) {
    mean[c](4, 4) = 0;
    variance[c](4, 4) = 0;
  }
  const Rgb lifted = corrected_variance(view(mean), view(variance), {}, {}, nullptr, {});
  EXPECT_NEAR(lifted[0](4, 4), 0.01, 1e-6);
  const Plane one = flat(1);
  const Rgb lone = corrected_variance(view(mean), view(variance), {}, {}, &one, {});
  EXPECT_NEAR(lone[0](4, 5), 1.0 / 9, 1e-5) << "eight ones and a zero";
}

TEST(Noise, InLabIsMeasuredFromHalvesOrVarianceWhateverFirefliesAndBackgroundDo) {
  // Grey at L* = 50 with a deviation of one unit of L*: dY = (116 / 3 Y^(-2/3))^-1.
  const double grey = 0.1841865, step = 3 * std::pow(grey, 2.0 / 3) / 116;
  Rgb mean, variance, a, b;
  for (size_t c = 0; c < 3; ++c) {
    // The same for the three channels, as grey light's noise is.
    const auto half = [&](double sign) {
      return plane_of(96, 96, [&](int x, int y) {
        if (x == 20 && y == 20) return sign > 0 ? 500.0 : 0.0;
        return x < 48 ? grey + sign * step * normal(x, y, 5) : 1.0;
      });
    };
    a[c] = half(1);
    b[c] = half(-1);
    mean[c] = plane_of(96, 96, [&](int x, int) { return x < 48 ? grey : 1.0; });
    variance[c] = plane_of(96, 96, [&](int x, int) { return x < 48 ? step * step : 0.0; });
  }
  const Plane medium = plane_of(96, 96, [](int x, int) { return x < 48 ? 1.0 : 0.0; });
  EXPECT_NEAR(lab_noise(view(mean), {}, view(a), view(b), 1, &medium), 1, 0.05);
  EXPECT_NEAR(lab_noise(view(mean), view(variance), {}, {}, 1, &medium), 1, 0.01);
  // Without a mask the quiet half is left out all the same, also where it is the larger one.
  EXPECT_NEAR(lab_noise(view(mean), {}, view(a), view(b), 1, nullptr), 1, 0.05);
  Rgb wide = mean, wide_a = mean, wide_b = mean;
  for (size_t c = 0; c < 3; ++c) {
    const auto quiet_but_for_a_corner = [&](const Plane& p) {
      return plane_of(96, 96, [&](int x, int y) { return x < 32 && y < 32 ? p(x, y) : 1.0f; });
    };
    wide_a[c] = quiet_but_for_a_corner(a[c]);
    wide_b[c] = quiet_but_for_a_corner(b[c]);
  }
  EXPECT_NEAR(lab_noise(view(wide), {}, view(wide_a), view(wide_b), 1, nullptr), 1, 0.1);
}

TEST(Noise, ThePictureItselfTellsIt) {
  Rgb picture;
  for (size_t c = 0; c < 3; ++c)
    picture[c] =
        plane_of(150, 150, [&](int x, int y) { return 0.3 + 0.002 * x - 0.001 * y + 0.05 * normal(x, y, 30 + c); });
  const Rgb v = picture_variance(view(picture), {});
  double mean = 0;
  for (int y = 10; y < 140; ++y)
    for (int x = 10; x < 140; ++x) mean += v[1](x, y) / (130.0 * 130.0);
  EXPECT_NEAR(mean, 0.0025, 0.00025);
}

}  // namespace
}  // namespace brume
