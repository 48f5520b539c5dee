// Texture of several octaves is no noise: a picture without statistics that shows it comes back no worse than it was.
// And noise is no texture, whatever its colours, its distribution and its level's changes over the picture.

#include "filters/patch/texture_share.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "filters/api/registry.h"
#include "filters/patch/picture_noise.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr int kWidth = 96, kHeight = 80;

/// Random values on a lattice, interpolated; in [-1, 1].
double lattice(double x, double y, uint64_t purpose) {
  const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
  const double u = x - i, v = y - j;
  const auto at = [&](int di, int dj) { return 2 * test::chance(i + di, j + dj, purpose) - 1; };
  return (1 - v) * ((1 - u) * at(0, 0) + u * at(1, 0)) + v * ((1 - u) * at(0, 1) + u * at(1, 1));
}

/// Six octaves, from a period of 1.7 px on, each `gain` times as strong as the next coarser one.
double octaves(int x, int y, double gain, uint64_t purpose) {
  double sum = 0, period = 1.7, amplitude = 1;
  for (int k = 0; k < 6; ++k, period *= 2, amplitude /= gain)
    sum += amplitude * lattice(x / period + 100, y / period + 100, purpose + static_cast<uint64_t>(k));
  return sum * std::pow(gain, 5);
}

/// Discs before one another, whose radii have a density of r^-3; the mean of 3 x 3 points of a pixel.
double discs(int x, int y, uint64_t purpose) {
  const auto at = [&](double px, double py) {
    for (int i = 0; i < 1500; ++i) {
      const double r = 1.5 / std::sqrt(1e-3 + test::chance(i, 0, purpose));
      const double dx = px - (kWidth + 20) * test::chance(i, 1, purpose) + 10,
                   dy = py - (kHeight + 20) * test::chance(i, 2, purpose) + 10;
      if (dx * dx + dy * dy < r * r) return 0.1 + 0.5 * test::chance(i, 3, purpose);
    }
    return 0.3;
  };
  double sum = 0;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) sum += at(x + (i - 1) / 3.0, y + (j - 1) / 3.0);
  return sum / 9;
}

/// A grey picture whose values are computed once.
Plane drawn(const std::function<double(int, int)>& value) {
  Plane plane(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) plane(x, y) = static_cast<float>(value(x, y));
  return plane;
}

using Noise = std::function<double(int x, int y, size_t c)>;

Layers frame_of(const Plane& truth, const Noise& noise) {
  Layers frame(kWidth, kHeight);
  test::put(frame, layer::beauty, "",
            [&](int x, int y, size_t c) { return truth(x, y) + static_cast<float>(noise(x, y, c)); });
  return frame;
}

double rms(const Layers& frame, const Plane& truth) {
  double sum = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const double d = static_cast<double>((*frame.rgb(layer::beauty)[c])(x, y)) - static_cast<double>(truth(x, y));
        sum += d * d;
      }
  return std::sqrt(sum / (3.0 * kWidth * kHeight));
}

Layers clean(const Layers& frame) {
  FilterSettings filter(find_filter("least_risk"));
  filter.set("network", "none");
  ApplyOptions options;
  options.component = Component::kAll;
  options.noise = NoiseSource::kSpatial;
  return apply_filter(filter, frame, options, {});
}

double mean_of(const Plane& plane) {
  double sum = 0;
  for (int y = 0; y < kHeight; ++y)
    for (const float v : plane.pixels(y)) sum += static_cast<double>(v);
  return sum / (kWidth * kHeight);
}

TEST(TextureShare, TextureComesBackNoWorse) {
  const std::pair<std::string, Plane> textures[] = {
      {"octaves of equal strength", drawn([](int x, int y) { return 0.3 + 0.1 * octaves(x, y, 1, 20); })},
      {"octaves of .7", drawn([](int x, int y) { return 0.3 + 0.2 * octaves(x, y, 0.7, 30); })},
      {"discs", drawn([](int x, int y) { return discs(x, y, 40); })},
      {"discs on one side",
       drawn([](int x, int y) { return x < kWidth / 2 ? discs(x, y, 50) : 0.2 + 0.001 * x; })},
  };
  for (const auto& [name, truth] : textures)
    for (const double deviation : {0.001, 0.003, 0.01}) {
      const Layers frame =
          frame_of(truth, [&](int x, int y, size_t) { return deviation * test::normal(x, y, 60); });
      EXPECT_LT(rms(clean(frame), truth), 1.02 * deviation) << name << ", deviation " << deviation;
    }
}

TEST(TextureShare, ACleanPictureStaysAsItIs) {
  const Plane truth = drawn([](int x, int y) { return discs(x, y, 70); });
  EXPECT_LT(rms(clean(frame_of(truth, [](int, int, size_t) { return 0.0; })), truth), 0.001);
}

TEST(TextureShare, NoiseIsNoTexture) {
  const Plane flat = drawn([](int, int) { return 0.4; });
  const Plane ramp = drawn([](int x, int y) { return 0.2 + 0.004 * x + 0.00003 * y * y; });
  // A mean of few samples, most of them dark.
  const auto of_samples = [](int x, int y, size_t) {
    Rng random(SampleKey{.pixel = static_cast<uint32_t>(y * kWidth + x)});
    double sum = 0;
    for (int i = 0; i < 4; ++i) sum += 0.1 * (-std::log(std::max(1e-9, static_cast<double>(random.uniform()))) - 1);
    return sum;
  };
  const std::pair<std::string, Noise> noises[] = {
      {"grey", [](int x, int y, size_t) { return 0.05 * test::normal(x, y, 90); }},
      {"coloured", [](int x, int y, size_t c) { return 0.05 * test::normal(x, y, 91 + c); }},
      {"of few samples", of_samples},
      {"more on one side", [](int x, int y, size_t) { return (x < 40 ? 0.1 : 0.03) * test::normal(x, y, 95); }},
  };
  for (const auto& [name, noise] : noises)
    for (const Plane* truth : {&flat, &ramp}) {
      const Layers frame = frame_of(*truth, noise);
      double true_variance = 0;
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) true_variance += std::pow(noise(x, y, 1), 2) / (kWidth * kHeight);
      const Rgb found = picture_variance(frame.rgb(layer::beauty), {});
      EXPECT_GT(mean_of(found[1]), 0.6 * true_variance) << name;
      EXPECT_GT(mean_of(share_of_noise(found, frame.rgb(layer::beauty), {})), 0.9) << name;
      EXPECT_LT(rms(clean(frame), *truth), 0.4 * rms(frame, *truth)) << name;
    }
}

// A variance that a file states, sixteen times too large or the same everywhere, is brought down to what can be.
TEST(StatedVariance, TooLargeDoesNoHarm) {
  const std::pair<std::string, Plane> pictures[] = {
      {"discs", drawn([](int x, int y) { return discs(x, y, 110); })},
      {"ramp", drawn([](int x, int y) { return 0.2 + 0.004 * x + 0.001 * y; })},
  };
  for (const auto& [name, truth] : pictures)
    for (const double stated : {0.01 * 0.01 * 1024, 1.0, 1e6}) {
      Layers frame = frame_of(truth, [](int x, int y, size_t) { return 0.01 * test::normal(x, y, 120); });
      test::put(frame, layer::beauty, statistic::mean_variance,
                [&](int, int, size_t) { return static_cast<float>(stated); });
      FilterSettings filter(find_filter("least_risk"));
      filter.set("network", "none");
      ApplyOptions options;
      options.component = Component::kAll;
      const double after = rms(apply_filter(filter, frame, options, {}), truth);
      EXPECT_LT(after, 0.01 * (name == "ramp" ? 0.4 : 1.02)) << name << ", " << stated;
    }
}

// A pixel filter spreads noise over neighbours: it varies less from one pixel to the next than the variance says.
TEST(StatedVariance, OfFilteredNoiseIsKept) {
  const auto filtered = [](int x, int y, size_t) {
    double sum = 0;
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        sum += (2 - std::abs(dx)) * (2 - std::abs(dy)) / 16.0 * test::normal(x + dx + 1, y + dy + 1, 130);
    return 0.05 * sum;
  };
  const Layers frame = frame_of(drawn([](int, int) { return 0.4; }), filtered);
  const float true_variance = static_cast<float>(0.05 * 0.05 * 0.375 * 0.375);
  Rgb variance;
  for (Plane& v : variance) v = Plane(kWidth, kHeight, true_variance);
  limit_variance(variance, frame.rgb(layer::beauty), {});
  for (const Plane& v : variance) EXPECT_NEAR(mean_of(v), true_variance, 0.02 * true_variance);
}

// One pixel, one row: nothing to measure, and nothing to fall over.
TEST(TextureShare, SmallPictures) {
  for (const ivec2& size : {ivec2(1, 1), ivec2(1, 40), ivec2(40, 1), ivec2(3, 3), ivec2(8, 8)}) {
    Rgb picture, variance;
    for (size_t c = 0; c < 3; ++c) {
      picture[c] = Plane(size.x, size.y);
      for (int y = 0; y < size.y; ++y)
        for (int x = 0; x < size.x; ++x) picture[c](x, y) = static_cast<float>(test::chance(x, y, 3));
      variance[c] = Plane(size.x, size.y, 0.01f);
    }
    const Plane share = share_of_noise(variance, view(picture), {});
    for (int y = 0; y < size.y; ++y)
      for (const float s : share.pixels(y)) EXPECT_TRUE(s >= 0 && s <= 1) << size.x << " x " << size.y;
  }
}

}  // namespace
}  // namespace brume
