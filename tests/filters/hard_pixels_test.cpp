// Pixels and recorded samples that once spoiled more than themselves, and sample counts that differ from pixel to
// pixel.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/rng.h"
#include "filters/api/registry.h"
#include "filters/inputs/extremes.h"
#include "filters/inputs/guide_layers.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

using test::noisy_frame;
using test::put;
using test::sampled_frame;

double largest_difference(const Layers& a, const Layers& b, const std::function<bool(int x, int y)>& where) {
  double largest = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x)
        if (where(x, y))
          largest =
              std::max<double>(largest, std::abs((*a.rgb(layer::beauty)[c])(x, y) - (*b.rgb(layer::beauty)[c])(x, y)));
  return largest;
}

float flat(int, int, size_t) {
  return 0.5f;
}

double rms_around(const Layers& clean, const Layers& frame, int px, int py) {
  double sum = 0;
  int n = 0;
  for (int y = 0; y < clean.height(); ++y)
    for (int x = 0; x < clean.width(); ++x) {
      if (std::max(std::abs(x - px), std::abs(y - py)) <= 1) continue;
      sum += std::pow(clean.at("G")(x, y) - frame.at("direct.G")(x, y) - 0.5, 2);
      ++n;
    }
  return std::sqrt(sum / n);
}

TEST(HardPixels, OnePixelOf1e20LeavesTheOthersOfBayesianCollaborativeFiltered) {
  const Layers frame = sampled_frame(90, 80, 32, 0.4, 1, flat);
  Layers hit = frame;
  for (size_t c = 0; c < 3; ++c) {
    (*hit.add_rgb(layer::indirect)[c])(40, 40) = 1e20f;
    (*hit.add_rgb(layer::indirect, statistic::mean_variance)[c])(40, 40) = 1e38f;
    (*hit.add_rgb(layer::indirect, statistic::buckets[2])[c])(40, 40) = 8e20f;
    (*hit.add_rgb(layer::indirect, statistic::half_a)[c])(40, 40) = 2e20f;
  }
  const FilterSettings f(find_filter("bayesian_collaborative"));
  ApplyOptions keep;
  keep.outliers = Outliers::kKeep;
  ApplyReport report;
  const Layers clean = apply_filter(f, frame, keep, {}), out = apply_filter(f, hit, keep, {}, &report);
  EXPECT_EQ(report.not_finite_results, 1u);
  EXPECT_EQ(out.at("G")(40, 40), 1e20f) << "keeps its input";
  EXPECT_LT(rms_around(out, frame, 40, 40), 1.1 * rms_around(clean, frame, 40, 40));
}

TEST(HardPixels, OnePixelOf1e8DoesNotMoveTheFloorOfLogLuminance) {
  const Layers frame = noisy_frame(80, 60, 2);
  Layers hit = frame;
  for (Plane* p : hit.add_rgb(layer::indirect)) (*p)(20, 20) = 1e8f;
  const FilterSettings f = parse_filter("extended_bilateral:domain=log-luminance");
  const int reach = f.apron();
  ApplyOptions keep;
  keep.outliers = Outliers::kKeep;
  EXPECT_EQ(largest_difference(apply_filter(f, frame, keep, {}), apply_filter(f, hit, keep, {}),
                               [&](int x, int y) { return std::max(std::abs(x - 20), std::abs(y - 20)) > reach; }),
            0);
}

TEST(HardPixels, RecordsThatAreNotFiniteAreReplacedAndCounted) {
  const Layers frame = sampled_frame(40, 30, 8, 0.3, 3, flat);
  Layers damaged = frame;
  (*damaged.add_rgb(layer::indirect, statistic::buckets[1])[0])(12, 9) = std::numeric_limits<float>::quiet_NaN();
  (*damaged.add_rgb(layer::indirect, statistic::buckets[5])[2])(25, 20) = std::numeric_limits<float>::infinity();
  const test::Records whole(frame), with_holes(damaged);
  for (const FilterEntry* e : all_filters()) {
    if (e->records == FilterEntry::Records::kNo) continue;
    FilterSettings f(*e);
    if (e->find("largest-neighborhood")) f.set("largest-neighborhood", "120");
    for (const int tile : {0, 24}) {
      ApplyOptions options;
      options.tile = tile;
      options.records = &const_cast<RecordReader&>(*with_holes.reader);
      ApplyReport report;
      const Layers out = apply_filter(f, frame, options, {}, &report);
      EXPECT_EQ(report.repaired_records, 2u) << e->name << " tile " << tile;
      for (const auto& [name, plane] : out.channels()) EXPECT_EQ(count_not_finite(plane), 0u) << e->name << " " << name;
      options.records = &const_cast<RecordReader&>(*whole.reader);
      apply_filter(f, frame, options, {}, &report);
      EXPECT_EQ(report.repaired_records, 0u) << e->name;
    }
  }
}

std::string refusal(const FilterSettings& f, const Layers& frame, const ApplyOptions& options) {
  try {
    apply_filter(f, frame, options, {});
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(HardPixels, AHoleOfNanIsClosedFromItsRimAndNeverBlack) {
  Layers frame = sampled_frame(60, 50, 16, 0.2, 5, flat);
  for (const std::string& name : frame.names())
    for (int y = 0; y < 50; ++y)
      for (int x = 0; x < 60; ++x)
        if ((x >= 20 && x < 29 && y >= 20 && y < 29) || (x > 47 && y > 40) || (x >= 5 && x < 8 && y >= 5 && y < 8))
          (*frame.find(name))(x, y) = std::numeric_limits<float>::quiet_NaN();
  for (const std::string name : {"transport_regression", "nfor", "gaussian"}) {
    ApplyOptions options;
    options.component = Component::kAll;
    ApplyReport report;
    const Layers clean = apply_filter(parse_filter(name), frame, options, {}, &report);
    EXPECT_EQ(report.repaired_pixels, 9u * 9u + 12u * 9u + 3u * 3u) << name;
    for (const char* channel : {"R", "G", "B"})
      for (int y = 0; y < 50; ++y)
        for (int x = 0; x < 60; ++x) ASSERT_GT(clean.at(channel)(x, y), 0.3) << name << " at " << x << ", " << y;
  }
}

TEST(HardPixels, APictureWithoutAFinitePixelIsRefused) {
  Layers frame = noisy_frame(30, 20, 5);
  for (Plane* p : frame.add_rgb(layer::indirect)) *p = Plane(30, 20, std::numeric_limits<float>::infinity());
  const std::string text = refusal(FilterSettings(find_filter("gaussian")), frame, {});
  EXPECT_NE(text.find("channel indirect.R: all 30 x 20 pixels are NaN or infinite"), std::string::npos) << text;
}

/// Adds to a pixel of the indirect light, its halves, buckets and variance, what one sample of 16, or all of them,
/// bring.
Layers with_bright_pixel(Layers frame, float value, bool one_sample, int x = 64, int y = 60) {
  for (const size_t c : {0u, 1u, 2u}) {
    const auto at = [&](std::string_view which) -> float& { return (*frame.add_rgb(layer::indirect, which)[c])(x, y); };
    at("") += value;
    for (const std::string_view half : {statistic::half_a, statistic::half_b})
      if (!one_sample)
        at(half) += value;
      else if (half == statistic::half_a)
        at(half) += 2 * value;
    for (const std::string_view bucket : statistic::buckets)
      if (!one_sample)
        at(bucket) += value;
      else if (bucket == statistic::buckets[0])
        at(bucket) += 8 * value;
    if (one_sample) at(statistic::mean_variance) += value * value;
  }
  return frame;
}

Layers without_halves(const Layers& frame) {
  Layers less(frame.width(), frame.height());
  for (const auto& [name, plane] : frame.channels())
    if (name.find("half_") == std::string::npos && name.find("bucket_") == std::string::npos) less.set(name, plane);
  return less;
}

// Before there was a limit, 1,000 changed 5,000 pixels of a cloud by more than 0.1, and 1e5 all of them.
TEST(BrightPixels, OneSampleChangesNoOtherPixelNoticeably) {
  const Layers frame = sampled_frame(128, 128, 16, 0.2, 8, flat), bare = without_halves(frame);
  for (const std::string name : {"transport_regression", "nl_means:buffers=one", "gaussian"}) {
    const FilterSettings f = parse_filter(name);
    const Layers clean = apply_filter(f, frame, {}, {}), clean_bare = apply_filter(f, bare, {}, {});
    for (const float value : {100.0f, 300.0f, 1e3f, 1e5f, 1e10f, 1e19f, 3e38f}) {
      const Layers hit = with_bright_pixel(frame, value, /*one_sample=*/true);
      ApplyReport report;
      const auto everywhere = [](int, int) { return true; };
      EXPECT_LT(largest_difference(apply_filter(f, hit, {}, {}, &report), clean, everywhere), 0.05)
          << name << " " << value;
      EXPECT_EQ(report.extreme_pixels, 1u) << name << " " << value;
      EXPECT_LT(largest_difference(apply_filter(f, without_halves(hit), {}, {}), clean_bare, everywhere), 0.05)
          << name << " without halves, " << value;
    }
  }
}

TEST(BrightPixels, TheLightOfOneSampleStaysInThePicture) {
  const Layers frame = sampled_frame(128, 128, 16, 0.2, 8, flat);
  const auto light = [](const Layers& l) {
    double sum = 0;
    for (int y = 0; y < l.height(); ++y)
      for (const float v : l.at("G").pixels(y)) sum += static_cast<double>(v);
    return sum;
  };
  for (const std::string name : {"transport_regression", "gaussian"}) {
    const FilterSettings f = parse_filter(name);
    ApplyReport report;
    const Layers clean = apply_filter(f, with_bright_pixel(frame, 60, /*one_sample=*/true), {}, {}, &report);
    EXPECT_NEAR(light(clean) - light(apply_filter(f, frame, {}, {})), 60, 4) << name;
    const std::string said = report.notes.empty() ? "" : report.notes.front();
    EXPECT_NE(said.find("1 pixel that one sample makes far brighter"), std::string::npos) << said;
    EXPECT_NE(said.find(" 0 % is lost"), std::string::npos) << said;
  }
}

TEST(BrightPixels, WhatBothHalvesShowStaysAndChangesNoOther) {
  const Layers frame = sampled_frame(128, 128, 16, 0.2, 8, flat);
  const FilterSettings f = parse_filter("transport_regression");
  const Layers clean = apply_filter(f, frame, {}, {});
  for (const float value : {5.0f, 10.0f, 17.0f, 100.0f, 1e5f, 3e38f}) {
    const Layers lit = apply_filter(f, with_bright_pixel(frame, value, /*one_sample=*/false), {}, {});
    EXPECT_NEAR(lit.at("G")(64, 60) / (value + 0.5 + frame.at("direct.G")(64, 60)), 1, 0.3) << value;
    EXPECT_LT(largest_difference(lit, clean, [](int x, int y) { return x != 64 || y != 60; }), 0.05) << value;
  }
}

TEST(BrightPixels, SamplesThatMeetByChanceAreNoPoint) {
  Layers frame = sampled_frame(128, 128, 16, 0.2, 8, flat);
  const FilterSettings f = parse_filter("transport_regression");
  for (const float value : {17.0f, 100.0f, 1e5f}) {
    Layers hit = with_bright_pixel(frame, value, /*one_sample=*/false);
    for (int i = 0; i < 12; ++i)
      hit = with_bright_pixel(std::move(hit), value, /*one_sample=*/true, 55 + 5 * (i % 4), 52 + 5 * (i / 4));
    EXPECT_LT(apply_filter(f, hit, {}, {}).at("G")(64, 60), 1 + 0.1f * value) << value;
  }
}

// Of many pixels some are bright in both halves, though none around them is bright in one. Guides know what light there is.
TEST(BrightPixels, ThatGuidesDoNotKnowAreHeldAgainstChanceInAllOfTheFrame) {
  const FilterSettings f = parse_filter("transport_regression");
  for (const float value : {60.0f, 1e5f}) {
    const auto shown = [&](int singles, bool guided) {
      Layers hit = with_bright_pixel(sampled_frame(128, 128, 16, 0.2, 8, flat), value, /*one_sample=*/false);
      for (int i = 0; i < singles; ++i)
        hit = with_bright_pixel(std::move(hit), value, /*one_sample=*/true, 5 + 14 * (i % 3), 5 + 9 * (i / 3));
      if (guided) {
        for (Plane* p : hit.add_rgb(guide_layer::predicted_indirect)) *p = Plane(128, 128, 0.5f);
        hit.add(guide_layer::opacity.channel(0)) = Plane(128, 128, 1.0f);
      }
      return apply_filter(f, hit, {}, {}).at("G")(64, 60) / value;
    };
    EXPECT_GT(shown(36, /*guided=*/false), 0.5) << value;
    EXPECT_LT(shown(36, /*guided=*/true), 0.1f + 2 / value) << value;
    EXPECT_GT(shown(0, /*guided=*/true), 0.5) << value;
  }
}

TEST(BrightPixels, AreNotFoundInSkewedNoise) {
  for (const int samples : {1, 4, 16, 64}) {
    Layers frame = sampled_frame(128, 128, samples, 0, 9, flat);
    for (int y = 0; y < 128; ++y)
      for (int x = 0; x < 128; ++x) {
        // One path in twenty finds the light.
        Rng rng(hash_combine(hash_combine(11, static_cast<uint64_t>(x)), static_cast<uint64_t>(y)));
        double sum = 0;
        for (int s = 0; s < samples; ++s)
          if (rng.uniform() < 0.05) sum += 10 * rng.exponential();
        for (Plane* p : frame.add_rgb(layer::indirect)) (*p)(x, y) = static_cast<float>(sum / samples);
      }
    ApplyReport report;
    apply_filter(parse_filter("gaussian"), without_halves(frame), {}, {}, &report);
    EXPECT_EQ(report.extreme_pixels, 0u) << samples;
  }
}

// Near a lamp in fog a pixel may outshine all around it: where the guides say so, it is no single sample.
TEST(BrightPixels, ThatGuidesPredictAreNotLimited) {
  constexpr float kValue = 60;
  const Layers frame = with_bright_pixel(sampled_frame(128, 128, 16, 0.2, 8, flat), kValue, /*one_sample=*/true);
  const auto found = [&](int x, float predicted) {
    Layers guided = frame;
    for (Plane* p : guided.add_rgb(guide_layer::predicted_indirect)) (*p)(x, 60) = predicted;
    return find_extremes(guided, layer::indirect, {});
  };
  EXPECT_EQ(found(64, kValue).size(), 0u);
  EXPECT_EQ(found(64, kValue / 9).size(), 0u) << "K is 25 at 16 samples";
  EXPECT_EQ(found(63, kValue).size(), 1u) << "of another pixel";
  // It comes down to what is predicted, if that is more than what is around it.
  const std::vector<Extreme> limited = found(64, kValue / 60);
  ASSERT_EQ(limited.size(), 1u);
  EXPECT_NEAR(limited[0].factor, 1.0 / 60, 2e-3);
}

TEST(BrightPixels, DoNotReachTheFramesBeforeAndAfter) {
  const Layers frame = sampled_frame(128, 128, 16, 0.2, 8, flat), other = sampled_frame(128, 128, 16, 0.2, 9, flat);
  for (const bool one_sample : {true, false}) {
    const Layers hit = with_bright_pixel(other, 1e5f, one_sample);
    const FilterSettings f = parse_filter("transport_regression");
    ApplyOptions calm, disturbed;
    calm.sequence = {{1, &other, nullptr}};
    disturbed.sequence = {{1, &hit, nullptr}};
    EXPECT_LT(largest_difference(apply_filter(f, frame, disturbed, {}), apply_filter(f, frame, calm, {}),
                                 [](int, int) { return true; }),
              0.02);
  }
}

// Left 4 samples per pixel, right 64: far from the seam each side is what a frame of such pixels alone gives.
TEST(SampleCounts, EachPixelsOwnDecides) {
  const auto frame_with = [](const test::Value& count) {
    const test::Value ramp = [](int x, int y, size_t) { return 0.5f + 0.002f * static_cast<float>(x + 2 * y); };
    Layers frame = sampled_frame(200, 24, 16, 0.5, 4, ramp);
    put(frame, layer::sample_count, "", count);
    put(frame, layer::transmittance, statistic::mean_variance, [](int, int, size_t) { return 4e-3f; });
    return frame;
  };
  const Layers few = frame_with([](int, int, size_t) { return 4.0f; }),
               many = frame_with([](int, int, size_t) { return 64.0f; }),
               mixed = frame_with([](int x, int, size_t) { return x < 100 ? 4.0f : 64.0f; });
  for (const std::string name : {"virtual_flash", "sbf:scale=0.5"}) {
    const FilterSettings f = parse_filter(name);
    const Layers a = apply_filter(f, few, {}, {}), b = apply_filter(f, many, {}, {}),
                 c = apply_filter(f, mixed, {}, {});
    const int reach = f.apron() + kNoiseReach;
    ASSERT_LT(reach, 95) << name;
    EXPECT_EQ(largest_difference(c, a, [&](int x, int) { return x < 100 - reach; }), 0) << name;
    EXPECT_EQ(largest_difference(c, b, [&](int x, int) { return x >= 100 + reach; }), 0) << name;
    EXPECT_GT(largest_difference(a, b, [](int, int) { return true; }), 1e-4) << name << " does not read the counts";
  }
}

TEST(Guided, RefusesWithoutFeaturesInsteadOfBlurring) {
  const Layers frame = noisy_frame(30, 20, 5);
  const FilterSettings guided(find_filter("guided"));
  ApplyOptions none;
  none.features = {"none"};
  EXPECT_NE(refusal(guided, frame, none).find("--features none leaves it none"), std::string::npos);
  Layers bare(30, 20), constant = frame;
  for (const LayerName& l : {layer::direct, layer::indirect, layer::beauty})
    for (const std::string& channel : l.channel_names()) bare.set(channel, frame.at(channel));
  const std::string text = refusal(guided, bare, {});
  EXPECT_NE(text.find("is led by features, and the frame has none"), std::string::npos) << text;
  EXPECT_NE(text.find("brume render SCENE -o OUT.exr --layers"), std::string::npos) << text;
  for (const LayerName& l : {layer::transmittance, layer::gradient, layer::gradient_transmittance_weighted})
    put(constant, l, "", [](int, int, size_t) { return 0.5f; });
  EXPECT_NE(refusal(guided, constant, {}).find("no feature of the frame varies by more than its noise"),
            std::string::npos);
}

// Means and variances of samples of one exponential distribution rise and fall together, so that a filter which weighs
// by the measured variance darkens the picture.
TEST(LocalRegression, DoesNotDarkenSkewedLight) {
  constexpr int kSamples = 8;
  Layers frame = sampled_frame(60, 50, kSamples, 0, 6, flat);
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < 50; ++y)
      for (int x = 0; x < 60; ++x) {
        Rng rng(hash_combine(hash_combine(7 + c, static_cast<uint64_t>(x)), static_cast<uint64_t>(y)));
        double sum = 0, squares = 0;
        for (int s = 0; s < kSamples; ++s) {
          const double v = 0.5 * rng.exponential();
          sum += v;
          squares += v * v;
        }
        (*frame.add_rgb(layer::indirect)[c])(x, y) = static_cast<float>(sum / kSamples);
        (*frame.add_rgb(layer::indirect, statistic::mean_variance)[c])(x, y) =
            static_cast<float>((squares - sum * sum / kSamples) / (kSamples - 1) / kSamples);
      }
  Layers given(60, 50);  // without halves, which would speak of the variance too
  for (const auto& [name, plane] : frame.channels())
    if (name.find("half") == std::string::npos) given.set(name, plane);
  ApplyOptions options;
  options.features = {"none"};
  const Layers out = apply_filter(parse_filter("wlr:rejection=100"), given, options, {});
  double mean = 0;
  for (int y = 0; y < 50; ++y)
    for (int x = 0; x < 60; ++x) mean += (out.at("G")(x, y) - frame.at("direct.G")(x, y)) / (60 * 50);
  EXPECT_NEAR(mean, 0.5, 0.01);
}

}  // namespace
}  // namespace brume
