// Widths from curves of bias and variance, and what is made of them: docs/methods.md, Widths from bias
// and variance.

#include "filters/regression/bandwidth.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "filters/api/registry.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr std::array<double, 5> kAlphas = {0.1, 1, 2, 4, 8}, kBandwidths = {0.2, 0.4, 0.6, 0.8, 1};

/// Curves that follow the laws the fits assume.
struct Planted {
  std::array<double, 5> bias, variance;
  Planted(const std::array<double, 5>& widths, double b0, double b1, double v0, double v1, double n, int k) {
    for (size_t i = 0; i < 5; ++i) {
      bias[i] = b0 + b1 * widths[i] * widths[i];
      variance[i] = (v0 + v1 * std::pow(widths[i], -k)) / n;
    }
  }
};

TEST(Bandwidth, PlantedCurvesGiveTheClosedFormsWidth) {
  for (const double b1 : {-0.02, 0.004, 0.3})
    for (const double v1 : {0.01, 0.5})
      for (const double n : {4.0, 64.0}) {
        const Planted p(kAlphas, 0, b1, 0.02, v1, n, 2);
        const double closed = std::clamp(std::pow(v1 / (2 * b1 * b1 * n), 1.0 / 6), 0.1, 8.0);
        EXPECT_NEAR(best_pixel_width({kAlphas, p.bias, p.variance, n}, 0.1, 8), closed, 1e-6 * closed);
        for (const int k : {2, 3, 7}) {
          const Planted q(kBandwidths, 0.1, b1, 0.02, v1, n, k);
          const double h = std::clamp(std::pow(k * v1 / (4 * b1 * b1 * n), 1.0 / (k + 4)), 0.01, 1.0);
          EXPECT_NEAR(best_bandwidth({kBandwidths, q.bias, q.variance, n}, k, 1, 0.01, 1), h, 1e-6 * h) << k;
        }
      }
}

TEST(Bandwidth, NoBiasOrNoVarianceEndAtTheLimits) {
  const Planted flat(kAlphas, 0.1, 0, 0, 0.5, 4, 2), quiet(kAlphas, 0, 0.1, 0, -0.5, 4, 2);
  EXPECT_EQ(best_pixel_width({kAlphas, flat.bias, flat.variance, 4}, 0.1, 8), 8);
  EXPECT_EQ(best_pixel_width({kAlphas, quiet.bias, quiet.variance, 4}, 0.1, 8), 0.5);
  EXPECT_EQ(best_bandwidth({kBandwidths, flat.bias, flat.variance, 4}, 2, 1, 0.01, 1), 1);
}

// Features that say nothing leave local regression the picture's two dimensions: the result is the one without them.
TEST(Bandwidth, ConstantFeaturesLeaveTwoDimensions) {
  const Layers frame = test::noisy_frame(40, 30, 3);
  const FilterSettings wlr(find_filter("wlr"));
  const auto filtered = [&](const std::vector<Feature>& features) {
    FilterFrame f{layer::indirect, frame.rgb(layer::indirect), frame.rgb(layer::indirect), frame};
    f.variance = frame.rgb(layer::indirect, statistic::mean_variance);
    f.features = &features;
    f.samples = 16;
    Rgb out{Plane(40, 30), Plane(40, 30), Plane(40, 30)};
    wlr.run(f, {&out[0], &out[1], &out[2]}, {});
    return out;
  };
  std::vector<Feature> constant(2);
  for (Feature& feature : constant) {
    feature.name = "constant";
    for (int c = 0; c < 3; ++c) {
      feature.mean.emplace_back(40, 30, 0.3f);
      feature.variance.emplace_back(40, 30, 1e-6f);
    }
  }
  std::vector<Feature> ramp = constant;
  ramp[0].mean[0] = make_plane(40, 30, {}, [](int x, int y) { return 0.02f * static_cast<float>(x * y % 17); });
  const Rgb without = filtered({}), with = filtered(constant), other = filtered(ramp);
  double worst = 0, change = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 40; ++x) {
        worst = std::max(worst, std::abs(static_cast<double>(with[c](x, y)) - without[c](x, y)));
        change = std::max(change, std::abs(static_cast<double>(other[c](x, y)) - without[c](x, y)));
      }
  EXPECT_LT(worst, 1e-5);
  EXPECT_GT(change, 1e-3) << "a feature that varies takes part";
}

// What the map allots are all samples there are, whatever the tiles; no pixel gets more than eight times its share.
TEST(Bandwidth, SamplingMapAllotsEverySample) {
  Layers frame = test::noisy_frame(120, 90, 5);
  for (const std::string& channel : layer::indirect.channel_names()) frame.add(channel)(60, 45) = 300;
  ApplyOptions options;
  FilterSettings f(find_filter("sobel_guided"));
  for (const int tile : {0, 40}) {
    options.tile = tile;
    const Layers result = apply_filter(f, frame, options, {}, nullptr);
    const Plane& map = result.at(layer::sampling_map.channel(0));
    double sum = 0;
    float most = 0;
    for (int y = 0; y < 90; ++y)
      for (const float v : map.pixels(y)) {
        sum += v;
        most = std::max(most, v);
      }
    EXPECT_NEAR(sum / (120 * 90), 1, 1e-5) << tile;
    EXPECT_LE(most, 8) << tile;
    EXPECT_GT(most, 2) << "the spike asks for more";
  }
}

}  // namespace
}  // namespace brume
