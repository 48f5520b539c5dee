// Estimated errors against true ones, on pictures whose noise is known.

#include "filters/patch/selection.h"

#include <gtest/gtest.h>

#include <cmath>

#include "filters/patch/neighbourhood.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr int kWidth = 90, kHeight = 80, kPictures = 12;
constexpr float kDeviation = 0.1f;

struct Noisy {
  Rgb truth, picture, variance;
  explicit Noisy(uint64_t seed) {
    for (size_t c = 0; c < 3; ++c) {
      truth[c] = make_plane(kWidth, kHeight, {}, [&](int x, int y) {
        return 0.5f + 0.2f * std::sin(0.1f * static_cast<float>(x + 3 * static_cast<int>(c))) + (y > 40 ? 0.3f : 0.0f);
      });
      picture[c] = make_plane(kWidth, kHeight, {}, [&](int x, int y) {
        return truth[c](x, y) + kDeviation * static_cast<float>(test::normal(x, y, 10 * seed + c));
      });
      variance[c] = Plane(kWidth, kHeight, kDeviation * kDeviation);
    }
  }
};

/// Mean of estimated minus true squared error over pictures, in units of the noise's variance, and its standard error.
struct Bias {
  double mean = 0, error = 0;
};

template <class Filter>
Bias bias_of(const Filter& clean_and_derivative) {
  std::vector<double> differences;
  for (uint64_t seed = 1; seed <= kPictures; ++seed) {
    const Noisy n(seed);
    const auto [clean, derivative] = clean_and_derivative(n);
    double sum = 0;
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
          const double wrong = clean[c](x, y) - n.truth[c](x, y);
          sum += static_cast<double>(
                     stein_risk(clean[c](x, y), n.picture[c](x, y), n.variance[c](x, y), derivative[c](x, y))) -
                 wrong * wrong;
        }
    differences.push_back(sum / (3.0 * kWidth * kHeight * kDeviation * kDeviation));
  }
  Bias b;
  for (const double d : differences) b.mean += d / kPictures;
  double squares = 0;
  for (const double d : differences) squares += (d - b.mean) * (d - b.mean);
  b.error = std::sqrt(squares / (kPictures - 1) / kPictures);
  return b;
}

// Three standard errors are 0.8 % of the noise's variance in both: a factor of two on the derivative's term, or one V
// forgotten, is ten times that.

TEST(SteinRisk, OfAGaussianIsItsTrueError) {
  const Bias b = bias_of([](const Noisy& n) {
    const Averages a = weighted_average({}, gaussian_window(6, 1.2), view(n.picture), {});
    std::array<Plane, 3> own;
    for (Plane& p : own) p = make_plane(kWidth, kHeight, {}, [&](int x, int y) { return 1 / a.weight(x, y); });
    return std::pair(a.values, own);
  });
  EXPECT_LT(b.error, 0.004);
  EXPECT_LT(std::abs(b.mean), 3 * b.error);
}

TEST(SteinRisk, OfNonLocalMeansIsItsTrueErrorByNudging) {
  const Bias b = bias_of([](const Noisy& n) {
    const auto filtered = [&](const Rgb& picture) {
      WeightModel model;
      model.distances.push_back(noise_distance(view(picture), view(n.variance), 1, 0.6f));
      return weighted_average(model, square_window(4), view(picture), {}).values;
    };
    const std::vector<Plane> clean = filtered(n.picture);
    const Nudged other = nudged(view(n.picture), view(n.variance), {0, 0}, {});
    const std::vector<Plane> moved = filtered(other.picture);
    std::array<Plane, 3> derivative;
    for (size_t c = 0; c < 3; ++c)
      derivative[c] = make_plane(kWidth, kHeight, {},
                                 [&](int x, int y) { return (moved[c](x, y) - clean[c](x, y)) / other.step[c](x, y); });
    return std::pair(clean, derivative);
  });
  EXPECT_LT(b.error, 0.004);
  EXPECT_LT(std::abs(b.mean), 3 * b.error);
}

TEST(SelectByHalves, TakesTheBetterCandidateWhereItIsBetter) {
  // One candidate is right on the left, the other on the right.
  const Noisy a(101), b(102);
  HalfPair left, right;
  for (size_t c = 0; c < 3; ++c)
    for (auto& [pair, good_left] : {std::pair(&left, true), {&right, false}})
      for (Rgb* half : {&pair->a, &pair->b})
        (*half)[c] = make_plane(kWidth, kHeight, {}, [&](int x, int y) {
          return a.truth[c](x, y) + ((x < kWidth / 2) == good_left ? 0.0f : 0.1f);
        });
  const HalfPair chosen = select_by_halves({left, right}, view(a.picture), view(b.picture), view(a.variance),
                                           {5, 1, 1.0f}, view(a.picture), {});
  double wrong = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) wrong += std::abs(chosen.a[1](x, y) - a.truth[1](x, y)) / (kWidth * kHeight);
  EXPECT_LT(wrong, 0.01) << "a tenth is what the worse candidate is off by";
}

}  // namespace
}  // namespace brume
