// What every filter must survive (docs/methods.md), looped over the registry: each filter at its defaults and with
// every choice of its options.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>

#include "base/error.h"
#include "base/rng.h"
#include "filters/api/registry.h"
#include "filters/regression/regression.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

using test::frame_of;
using test::noisy_frame;
using test::Records;

std::vector<FilterSettings> every_filter() {
  std::vector<FilterSettings> list;
  const auto add = [&](const FilterEntry& e) -> FilterSettings& {
    list.emplace_back(e);
    // What is tested here does not depend on how many samples a neighbourhood has, the time does.
    if (e.find("largest-neighborhood")) list.back().set("largest-neighborhood", "120");
    if (e.find("iterations")) list.back().set("iterations", "25");
    return list.back();
  };
  for (const FilterEntry* e : all_filters()) {
    if (e->learned) continue;  // what a network makes of flat and tiny pictures is in its weights: oidn_test.cpp
    add(*e);
    const FilterSettings defaults(*e);
    for (const Parameter& p : e->parameters) {
      if (p.name == "feature-set") continue;  // which features there are is decided before the filter
      for (const std::string& choice : p.choices) {
        if (Parameter::text(defaults.get(p)) == choice) continue;
        add(*e).set(p.name, choice);
        if (e->find("domain") && p.name == "average") {
          list.emplace_back(list.back());
          list.back().set("domain", "log-luminance");
        }
      }
    }
    if (e->find("feature-strength")) add(*e).set("feature-strength", "0.6");
    for (const Preset& preset : e->presets)
      if (!preset.settings.empty()) add(*e).set("preset", preset.name);
  }
  return list;
}

std::string label(const FilterSettings& f) {
  return f.entry().name + " " + f.text();
}

/// Runs a filter, with records where it needs them.
Layers apply(const FilterSettings& f, const Layers& frame, ApplyOptions options = {}, const Task& task = {},
             ApplyReport* report = nullptr) {
  std::optional<Records> records;
  if (f.entry().records == FilterEntry::Records::kNeeds) options.records = &*records.emplace(frame).reader;
  return apply_filter(f, frame, options, task, report);
}

void expect_all_finite(const Layers& out, const std::string& what) {
  for (const auto& [name, plane] : out.channels()) EXPECT_EQ(count_not_finite(plane), 0u) << what << " " << name;
}

TEST(EveryFilter, LeavesConstantsAlone) {
  for (const FilterSettings& f : every_filter())
    for (const float value : {0.0f, 0.3f, 50.0f}) {
      const Layers frame = frame_of(
          30, 20, [value](int, int, size_t c) { return value * (1.0f + 0.2f * static_cast<float>(c)); }, 0.013, 0);
      const Layers out = apply(f, frame, {}, {});
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < 20; ++y)
          for (int x = 0; x < 30; ++x)
            ASSERT_NEAR((*out.rgb(layer::beauty)[c])(x, y), (*frame.rgb(layer::beauty)[c])(x, y),
                        2e-5f * std::max(1.0f, value))
                << label(f);
    }
}

TEST(EveryFilter, RunsOnAnySize) {
  for (const FilterSettings& f : every_filter())
    for (const auto& [w, h] : {std::pair(1, 1), {1, 9}, {9, 1}, {2, 2}, {13, 1}, {17, 5}, {31, 33}})
      expect_all_finite(apply(f, noisy_frame(w, h, 1)), label(f));
}

TEST(EveryFilter, OneBadPixelStaysWithinTheWindowAndIsCounted) {
  ApplyOptions keep;
  keep.outliers = Outliers::kKeep;  // which would return the light of 1e30 to a neighbourhood of their own
  for (const FilterSettings& f : every_filter())
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -1.0f, 1e30f}) {
      Layers frame = noisy_frame(64, 48, 2);
      const Layers clean = apply(f, frame, keep, {});
      (*frame.add_rgb(layer::indirect)[1])(20, 24) = bad;
      ApplyReport report;
      const Layers out = apply(f, frame, keep, {}, &report);
      expect_all_finite(out, label(f));
      EXPECT_EQ(report.repaired_pixels, std::isfinite(bad) ? 0u : 1u);
      const int reach = f.apron() + (f.entry().can_use_statistics > Statistics::kNone ? kNoiseReach : 0);
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < 48; ++y)
          for (int x = 0; x < 64; ++x)
            if (std::abs(x - 20) > reach || std::abs(y - 24) > reach) {
              ASSERT_EQ((*out.rgb(layer::beauty)[c])(x, y), (*clean.rgb(layer::beauty)[c])(x, y))
                  << label(f) << " reach " << reach << " at " << x << " " << y << " value " << bad;
            }
    }
}

// Skewed noise in which rare samples are hundreds of times as bright as the rest, as light in water droplets has it: no
// filter may leave the range of the values around a pixel, far less turn black or negative there.
TEST(EveryFilter, StaysWithinTheValuesAroundAPixelWhateverTheFireflies) {
  constexpr int kWidth = 64, kHeight = 44, kReach = 15;
  const auto truth = [](int x, int y, size_t) { return x + y / 2 < 40 ? 1.0f : 3.0f; };
  const Layers frame = test::sampled_frame(kWidth, kHeight, 8, 5, truth, [&](int x, int y, size_t c, Rng& rng) {
    const double level = truth(x, y, c), skewed = level * (0.5 + 0.5 * rng.exponential());
    return rng.uniform() < 0.002 ? 300 * level * (1 + rng.uniform()) : skewed;
  });
  Rgb lowest, highest;
  for (size_t c = 0; c < 3; ++c) {
    const Plane &a = *frame.rgb(layer::indirect, statistic::half_a)[c],
                &b = *frame.rgb(layer::indirect, statistic::half_b)[c];
    const auto of_halves = [&](auto better) {
      return make_plane(kWidth, kHeight, {}, [&](int x, int y) { return better(a(x, y), b(x, y)); });
    };
    lowest[c] = window_minimum(of_halves([](float p, float q) { return std::min(p, q); }), kReach, {});
    highest[c] = window_maximum(of_halves([](float p, float q) { return std::max(p, q); }), kReach, {});
  }
  ApplyOptions options;
  options.outliers = Outliers::kKeep;
  for (const FilterSettings& f : every_filter()) {
    const Layers out = apply(f, frame, options);
    expect_all_finite(out, label(f));
    // As published it averages logarithms of luminance, and each noisy pixel keeps its own colour: then only the
    // luminance stays within the range.
    const std::string text = f.text();
    const bool luminance_only =
        text.find("domain=log-luminance") != std::string::npos && text.find("average=domain") != std::string::npos;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        vec3 clean, least, most;
        for (size_t c = 0; c < 3; ++c) {
          const auto i = static_cast<int>(c);
          clean[i] = (*out.rgb(layer::beauty)[c])(x, y) - (*frame.rgb(layer::direct)[c])(x, y);
          least[i] = lowest[c](x, y);
          most[i] = highest[c](x, y);
        }
        if (luminance_only)
          for (vec3* v : {&clean, &least, &most}) *v = vec3(glm::dot(*v, vec3(0.265f, 0.670f, 0.065f)));
        for (int c = 0; c < 3; ++c) {
          EXPECT_GE(clean[c], 0.9f * least[c]) << label(f) << " at " << x << " " << y;
          EXPECT_LE(clean[c], 1.1f * most[c]) << label(f) << " at " << x << " " << y;
        }
      }
  }
}

TEST(EveryFilter, RefusesAFrameOfNothingButNaN) {
  for (const FilterSettings& f : every_filter()) {
    const Layers frame = frame_of(20, 10, [](int, int, size_t) { return std::numeric_limits<float>::quiet_NaN(); });
    EXPECT_THROW(apply(f, frame, {}, {}), InputError) << label(f);
  }
}

TEST(EveryFilter, TheSameBitsForAnyNumberOfThreads) {
  for (const FilterSettings& f : every_filter()) {
    const Layers frame = noisy_frame(70, 55, 3);
    const Layers one = apply(f, frame, {}, {1, {}, nullptr});
    for (const int threads : {2, 7}) {
      const Layers many = apply(f, frame, {}, {threads, {}, nullptr});
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < 55; ++y)
          for (int x = 0; x < 70; ++x)
            ASSERT_EQ(std::bit_cast<uint32_t>((*one.rgb(layer::beauty)[c])(x, y)),
                      std::bit_cast<uint32_t>((*many.rgb(layer::beauty)[c])(x, y)))
                << label(f);
    }
  }
}

Layers transformed(const Layers& in, bool transpose, bool mirror) {
  Layers out(transpose ? in.height() : in.width(), transpose ? in.width() : in.height());
  for (const auto& [name, plane] : in.channels()) {
    Plane& p = out.add(name);
    for (int y = 0; y < in.height(); ++y)
      for (int x = 0; x < in.width(); ++x) {
        const int mx = mirror ? in.width() - 1 - x : x;
        (transpose ? p(y, mx) : p(mx, y)) = plane(x, y);
      }
  }
  return out;
}

TEST(EveryFilter, FollowsMirrorsAndQuarterTurns) {
  for (const FilterSettings& f : every_filter()) {
    // Random numbers by the pixel's place do not turn with the picture, nor does the order in which patches claim
    // pixels.
    if (f.entry().seeded) continue;
    const Layers frame = noisy_frame(37, 26, 4), out = apply(f, frame, {}, {});
    for (const auto& [transpose, mirror] : {std::pair(false, true), {true, false}, {true, true}}) {
      const Layers other = apply(f, transformed(frame, transpose, mirror), {}, {}),
                   expected = transformed(out, transpose, mirror);
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < other.height(); ++y)
          for (int x = 0; x < other.width(); ++x)
            ASSERT_NEAR((*other.rgb(layer::beauty)[c])(x, y), (*expected.rgb(layer::beauty)[c])(x, y), 2e-4f)
                << label(f);
    }
  }
}

TEST(EveryFilter, DoesNotCareWhichHalfIsWhich) {
  for (const FilterSettings& f : every_filter()) {
    if (f.entry().records == FilterEntry::Records::kNeeds) continue;  // has samples, not halves
    const Layers frame = noisy_frame(37, 26, 4);
    Layers swapped = frame;
    for (const auto& [name, plane] : frame.channels())
      for (const auto& [from, to] : {std::pair("half_a", "half_b"), {"half_b", "half_a"}})
        if (const size_t at = name.find(from); at != std::string::npos)
          swapped.set(std::string(name).replace(at, 6, to), plane);
    const Layers a = apply(f, frame, {}, {}), b = apply(f, swapped, {}, {});
    for (int y = 0; y < 26; ++y)
      for (int x = 0; x < 37; ++x) ASSERT_NEAR(a.at("G")(x, y), b.at("G")(x, y), 1e-5f) << label(f);
  }
}

TEST(EveryFilter, ReportsToOneAndStopsWhenCancelled) {
  for (const FilterSettings& f : every_filter()) {
    double last = 0;
    apply(f, noisy_frame(40, 60, 5), {},
          {1,
           [&](double v) {
             EXPECT_GE(v, last);
             last = v;
           },
           nullptr});
    EXPECT_EQ(last, 1.0) << label(f);
    std::atomic<bool> cancel{true};
    EXPECT_THROW(apply(f, noisy_frame(40, 60, 5), {}, {2, {}, &cancel}), Interrupted) << label(f);
  }
}

TEST(EveryFilter, ExposureIsTheSameAsScaledRadiance) {
  // A frame twice as bright at half the exposure is the same picture to a filter.
  for (const FilterSettings& f : every_filter()) {
    const Layers frame = noisy_frame(30, 30, 6);
    Layers bright = frame;
    for (const LayerName& l : {layer::direct, layer::indirect, layer::beauty, layer::flash}) {
      std::vector<std::string_view> statistics = {"", statistic::mean_variance, statistic::half_a, statistic::half_b};
      statistics.insert(statistics.end(), statistic::buckets.begin(), statistic::buckets.end());
      for (const std::string_view which : statistics)
        for (Plane* p : bright.add_rgb(l, which))
          for (int y = 0; y < 30; ++y)
            for (float& v : p->pixels(y)) v *= which == statistic::mean_variance ? 4.0f : 2.0f;
    }
    const Layers a = apply(f, frame, {Component::kIndirect, BackgroundRule::kDefault, 1.0}, {});
    const Layers b = apply(f, bright, {Component::kIndirect, BackgroundRule::kDefault, 0.5}, {});
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 30; ++x) ASSERT_NEAR(b.at("R")(x, y), 2 * a.at("R")(x, y), 1e-4f) << label(f);
  }
}

TEST(EveryFilter, NeverMakesFlatNoiseWorse) {
  for (const FilterSettings& f : every_filter()) {
    Rng rng(8);
    std::vector<float> noise;
    for (int i = 0; i < 64 * 64 * 3; ++i) noise.push_back(static_cast<float>(0.35 + 0.1 * rng.uniform()));
    const Layers frame = frame_of(
        64, 64, [&](int x, int y, size_t c) { return noise[static_cast<size_t>(y * 64 + x) * 3 + c]; }, 0.01 / 12);
    const Layers out = apply(f, frame, {}, {});
    double before = 0, after = 0;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) {
        const double truth = 0.4 + 0.01 * (x + y);
        before += std::pow(frame.at("G")(x, y) - truth, 2);
        after += std::pow(out.at("G")(x, y) - truth, 2);
      }
    EXPECT_LT(after, 0.25 * before) << label(f);
  }
}

TEST(EveryFilter, ComponentAllCleansTheBeautyAndIndirectKeepsTheDirect) {
  for (const FilterSettings& f : every_filter()) {
    if (f.text().find("guide=direct") != std::string::npos) continue;  // asked to look at it
    Layers frame = noisy_frame(24, 24, 9);
    const Layers indirect = apply(f, frame, {}, {});
    (*frame.add_rgb(layer::direct)[0])(12, 12) += 3.0f;
    const Layers changed = apply(f, frame, {}, {});
    EXPECT_NEAR(changed.at("R")(12, 12) - indirect.at("R")(12, 12), 3.0f, 1e-5f);
    EXPECT_EQ(changed.at("R")(13, 12), indirect.at("R")(13, 12)) << "the direct component leaked into its neighbour";
    (*frame.add_rgb(layer::beauty)[0])(12, 12) += 3.0f;
    const Layers all = apply(f, frame, {Component::kAll, BackgroundRule::kFilter, 1.0}, {});
    bool differs = false;
    for (int y = 0; y < 24; ++y)
      for (int x = 0; x < 24; ++x) differs |= all.at("R")(x, y) != changed.at("R")(x, y);
    EXPECT_TRUE(differs) << label(f) << ": filtering the sum is not filtering a part";
    EXPECT_EQ(all.text("filter"), f.entry().name);
    EXPECT_EQ(all.text("filterParameters"), f.text());
  }
}

TEST(EveryFilter, SaysWhichLayersAreMissingAndHowToRecordThem) {
  for (const FilterEntry* e : all_filters()) {
    Layers frame(8, 8);
    frame.add_rgb(layer::beauty);
    try {
      apply_filter(FilterSettings(*e), frame, {}, {});
      FAIL() << e->name;
    } catch (const InputError& error) {
      const std::string text = error.what();
      EXPECT_NE(text.find("'direct', 'indirect'"), std::string::npos) << text;
      EXPECT_NE(text.find("brume render SCENE -o OUT.exr --layers direct,indirect"), std::string::npos) << text;
      for (const LayerName& l : e->needs) EXPECT_NE(text.find("'" + l.label() + "'"), std::string::npos) << text;
    }
  }
}

}  // namespace
}  // namespace brume
