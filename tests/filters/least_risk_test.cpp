// Never worse than the noisy picture, at any noise, whatever is known of it; and far better where there is little
// detail. Pictures of which any smoothing loses something: lines, text, grids, weaves, stars.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "filters/api/registry.h"
#include "filters/patch/picture_noise.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr int kWidth = 96, kHeight = 72;

struct Picture {
  const char* name;
  bool smooth;      ///< hardly any detail
  bool like_noise;  ///< which nobody can tell from noise without statistics
  test::Value value;
};

bool letter(int x, int y) {
  // Strokes of one pixel in cells of 6 x 8, by turns upright, level and slanted.
  const int u = x % 6, v = y % 8, kind = (x / 6 * 7 + y / 8 * 3) % 5;
  if (u == 5 || v >= 7) return false;
  return kind == 0   ? u == 2 || v == 0
         : kind == 1 ? u == 0 || v == 3
         : kind == 2 ? u == v / 2 + 1
         : kind == 3 ? v == 6 || u == 4 - v / 2
                     : u == 1 || u == 3;
}

const std::vector<Picture>& pictures() {
  static const std::vector<Picture> list = {
      {"flat", true, false, [](int, int, size_t) { return 0.4f; }},
      {"cloud", true, false,
       [](int x, int y, size_t c) {
         return 0.3f +
                0.2f * static_cast<float>(std::sin(0.05 * x + 0.3 * static_cast<double>(c)) * std::cos(0.07 * y));
       }},
      {"edge", true, false, [](int x, int y, size_t) { return 2 * x + y > 120 ? 0.7f : 0.2f; }},
      {"lines", false, false, [](int x, int y, size_t) { return x % 8 == 2   ? 0.1f
                                                                : y % 8 == 0 ? 0.8f
                                                                             : 0.3f; }},
      {"hair", false, false, [](int x, int y, size_t) { return (3 * x + y) % 29 == 0 ? 1.0f : 0.2f; }},
      {"text", false, false, [](int x, int y, size_t) { return letter(x, y) ? 0.05f : 0.8f; }},
      {"checkers of 1", false, false, [](int x, int y, size_t) { return (x + y) % 2 ? 0.5f : 0.3f; }},
      {"checkers of 3", false, false, [](int x, int y, size_t) { return (x / 3 + y / 3) % 2 ? 0.6f : 0.2f; }},
      {"dots", false, false, [](int x, int y, size_t) { return x % 6 == 1 && y % 5 == 2 ? 0.9f : 0.1f; }},
      {"stars", false, false,
       [](int x, int y, size_t) {
         return test::chance(x, y, 7) < 0.01 ? static_cast<float>(0.2 + test::chance(x, y, 8)) : 0.05f;
       }},
      {"zone plate", false, false,
       [](int x, int y, size_t) { return static_cast<float>(0.4 + 0.3 * std::cos(0.009 * (x * x + y * y))); }},
      {"noise texture", false, true,
       [](int x, int y, size_t) { return static_cast<float>(0.2 + 0.4 * test::chance(x, y, 9)); }},
      {"rings", false, true, [](int x, int y, size_t) { return std::sin(0.02 * (x * x + y * y)) > 0 ? 0.6f : 0.3f; }},
  };
  return list;
}

enum class Known { kHalves, kVariance, kNothing };

Layers noisy(const Picture& picture, double deviation, uint64_t seed, Known known) {
  const Layers sampled = test::sampled_frame(kWidth, kHeight, 16, 4 * deviation, seed, picture.value);
  Layers frame(kWidth, kHeight);
  const auto copy = [&](std::string_view statistic) {
    for (size_t c = 0; c < 3; ++c)
      frame.set(layer::beauty.channel_of(statistic, c), sampled.at(layer::indirect.channel_of(statistic, c)));
  };
  copy("");
  if (known != Known::kNothing) copy(statistic::mean_variance);
  if (known == Known::kHalves) copy(statistic::half_a), copy(statistic::half_b);
  return frame;
}

double rms(const Layers& frame, const Picture& picture) {
  double sum = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (size_t c = 0; c < 3; ++c) {
        const double d =
            static_cast<double>((*frame.rgb(layer::beauty)[c])(x, y)) - static_cast<double>(picture.value(x, y, c));
        sum += d * d;
      }
  return std::sqrt(sum / (3.0 * kWidth * kHeight));
}

Layers clean(const Layers& frame, Known known) {
  FilterSettings filter(find_filter("least_risk"));
  filter.set("network", "none");
  ApplyOptions options;
  options.component = Component::kAll;
  if (known == Known::kNothing) options.noise = NoiseSource::kSpatial;
  return apply_filter(filter, frame, options, {});
}

TEST(LeastRisk, IsNeverWorseThanTheNoisyPicture) {
  for (const Picture& picture : pictures())
    for (const Known known : {Known::kHalves, Known::kVariance, Known::kNothing})
      for (const double deviation : {0.3, 0.1, 0.03, 0.01, 0.003, 0.0005}) {
        if (picture.like_noise && known == Known::kNothing) continue;
        const Layers frame = noisy(picture, deviation, 5, known);
        const double before = rms(frame, picture), after = rms(clean(frame, known), picture);
        EXPECT_LT(after, 1.02 * before) << picture.name << ", deviation " << deviation << ", known "
                                        << static_cast<int>(known);
        if (picture.smooth && deviation >= 0.01) {
          EXPECT_LT(after, 0.5 * before) << picture.name << ", deviation " << deviation << ", known "
                                         << static_cast<int>(known);
        }
      }
}

// The opacity of thin smoke at few samples: what it says of a pixel is how many of its samples met the smoke, and so is
// the picture. A fit to it keeps all the noise, and its errors by one half and by the other are the same.
TEST(LeastRisk, IsNotLedByAFeatureThatHasThePicturesNoise) {
  const Picture& flat = pictures()[0];
  Layers frame = noisy(flat, 0.1, 5, Known::kHalves);
  const double alone = rms(clean(frame, Known::kHalves), flat);
  for (const auto which : {std::string_view(), statistic::mean_variance, statistic::half_a, statistic::half_b})
    for (size_t c = 0; c < 3; ++c)
      frame.set(layer::transmittance.channel_of(which, c), frame.at(layer::beauty.channel_of(which, c)));
  EXPECT_LT(rms(clean(frame, Known::kHalves), flat), 1.1 * alone);
}

TEST(PictureNoise, TellsNoiseFromDetailThatRepeatsItself) {
  for (const Picture& picture : pictures()) {
    const bool repeats =
        std::set<std::string>{"lines", "checkers of 1", "checkers of 3", "dots", "stars"}.contains(picture.name);
    if (!picture.smooth && !repeats) continue;
    constexpr double kVariance = 1e-4;
    const Layers frame = noisy(picture, std::sqrt(kVariance), 6, Known::kNothing);
    const Rgb variance = picture_variance(frame.rgb(layer::beauty), {});
    std::vector<float> values;
    for (int y = 0; y < kHeight; ++y)
      for (const float v : variance[1].pixels(y)) values.push_back(v);
    std::nth_element(values.begin(), values.begin() + static_cast<long>(values.size() / 2), values.end());
    const auto median = static_cast<double>(values[values.size() / 2]);
    EXPECT_LT(median, 1.6 * kVariance) << picture.name;
    if (picture.smooth) {
      EXPECT_GT(median, 0.5 * kVariance) << picture.name;
    }
  }
}

}  // namespace
}  // namespace brume
