// What every filter must survive (FILTERS.md section F), looped over the registry: each filter at its defaults and with
// every choice of its options.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/rng.h"
#include "filters/apply.h"
#include "filters/registry.h"

namespace brume {
namespace {

std::vector<FilterSettings> every_filter() {
  std::vector<FilterSettings> list;
  for (const FilterEntry* e : all_filters()) {
    list.emplace_back(*e);
    for (const Parameter& p : e->parameters)
      for (const std::string& choice : p.choices) {
        list.emplace_back(*e);
        list.back().set(p.name, choice);
        if (e->name == "extended_bilateral" && (p.name == "hue" || p.name == "logarithm" || p.name == "average")) {
          list.emplace_back(list.back());
          list.back().set("domain", "log-luminance");
        }
      }
  }
  return list;
}

std::string label(const FilterSettings& f) {
  return f.entry().name + " " + f.text();
}

Layers frame_of(int width, int height, const std::function<float(int, int, size_t)>& indirect) {
  Layers frame(width, height);
  const auto put = [&](const LayerName& l, const std::function<float(int, int, size_t)>& value) {
    for (size_t c = 0; c < l.channels.size(); ++c) {
      Plane& p = frame.add(l.channel(c));
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) p(x, y) = value(x, y, c);
    }
  };
  put(layer::indirect, indirect);
  put(layer::direct, [](int x, int y, size_t) { return 0.01f * static_cast<float>(x + y); });
  put(layer::gradient, [](int x, int y, size_t c) {
    return std::array{0.6f, 0.8f * (x % 2 ? 1.0f : -1.0f), y % 5 ? 0.1f : 0.0f}[c];
  });
  put(layer::coverage, [](int x, int, size_t) { return x % 7 == 0 ? 0.0f : 1.0f; });
  put(layer::alpha, [](int x, int, size_t) { return x % 7 == 0 ? 0.0f : 0.5f; });
  put(layer::beauty, [&](int x, int y, size_t c) { return indirect(x, y, c) + 0.01f * static_cast<float>(x + y); });
  return frame;
}

Layers noisy_frame(int width, int height, uint64_t seed) {
  std::vector<float> noise;
  Rng rng(seed);
  for (int i = 0; i < width * height * 3; ++i) noise.push_back(static_cast<float>(0.2 + 0.4 * rng.uniform()));
  return frame_of(width, height, [&](int x, int y, size_t c) {
    return noise[static_cast<size_t>(y * width + x) * 3 + c] + (x > width / 2 ? 0.5f : 0.0f);
  });
}

void expect_all_finite(const Layers& out, const std::string& what) {
  for (const auto& [name, plane] : out.channels()) EXPECT_EQ(count_not_finite(plane), 0u) << what << " " << name;
}

TEST(EveryFilter, LeavesConstantsAlone) {
  for (const FilterSettings& f : every_filter())
    for (const float value : {0.0f, 0.3f, 50.0f}) {
      const Layers frame =
          frame_of(30, 20, [value](int, int, size_t c) { return value * (1.0f + 0.2f * static_cast<float>(c)); });
      const Layers out = apply_filter(f, frame, {}, {});
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
      expect_all_finite(apply_filter(f, noisy_frame(w, h, 1), {}, {}), label(f));
}

TEST(EveryFilter, OneBadPixelStaysWithinTheWindowAndIsCounted) {
  for (const FilterSettings& f : every_filter())
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -1.0f, 1e30f}) {
      Layers frame = noisy_frame(64, 48, 2);
      const Layers clean = apply_filter(f, frame, {}, {});
      (*frame.add_rgb(layer::indirect)[1])(20, 24) = bad;
      ApplyReport report;
      const Layers out = apply_filter(f, frame, {}, {}, &report);
      expect_all_finite(out, label(f));
      EXPECT_EQ(report.repaired_pixels, std::isfinite(bad) ? 0u : 1u);
      const int reach = f.apron();
      // Log-luminance has a floor at a fraction of the whole picture's mean, which one huge pixel moves.
      if (f.text().find("log-luminance") != std::string::npos) continue;
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < 48; ++y)
          for (int x = 0; x < 64; ++x)
            if (std::abs(x - 20) > reach || std::abs(y - 24) > reach) {
              ASSERT_EQ((*out.rgb(layer::beauty)[c])(x, y), (*clean.rgb(layer::beauty)[c])(x, y))
                  << label(f) << " reach " << reach << " at " << x << " " << y << " value " << bad;
            }
    }
}

TEST(EveryFilter, AFrameOfNothingButNaNEndsFinite) {
  for (const FilterSettings& f : every_filter()) {
    const Layers frame = frame_of(20, 10, [](int, int, size_t) { return std::numeric_limits<float>::quiet_NaN(); });
    ApplyReport report;
    expect_all_finite(apply_filter(f, frame, {}, {}, &report), label(f));
    EXPECT_EQ(report.repaired_pixels, 200u);
  }
}

TEST(EveryFilter, TheSameBitsForAnyNumberOfThreads) {
  for (const FilterSettings& f : every_filter()) {
    const Layers frame = noisy_frame(70, 55, 3);
    const Layers one = apply_filter(f, frame, {}, {1, {}, nullptr});
    for (const int threads : {2, 7}) {
      const Layers many = apply_filter(f, frame, {}, {threads, {}, nullptr});
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
    const Layers frame = noisy_frame(37, 26, 4), out = apply_filter(f, frame, {}, {});
    for (const auto& [transpose, mirror] : {std::pair(false, true), {true, false}, {true, true}}) {
      const Layers other = apply_filter(f, transformed(frame, transpose, mirror), {}, {}),
                   expected = transformed(out, transpose, mirror);
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < other.height(); ++y)
          for (int x = 0; x < other.width(); ++x)
            ASSERT_NEAR((*other.rgb(layer::beauty)[c])(x, y), (*expected.rgb(layer::beauty)[c])(x, y), 3e-5f)
                << label(f);
    }
  }
}

TEST(EveryFilter, ReportsToOneAndStopsWhenCancelled) {
  for (const FilterSettings& f : every_filter()) {
    double last = 0;
    apply_filter(f, noisy_frame(40, 60, 5), {},
                 {1,
                  [&](double v) {
                    EXPECT_GE(v, last);
                    last = v;
                  },
                  nullptr});
    EXPECT_EQ(last, 1.0) << label(f);
    std::atomic<bool> cancel{true};
    EXPECT_THROW(apply_filter(f, noisy_frame(40, 60, 5), {}, {2, {}, &cancel}), Interrupted) << label(f);
  }
}

TEST(EveryFilter, ExposureIsTheSameAsScaledRadiance) {
  // A frame twice as bright at half the exposure is the same picture to a filter.
  for (const FilterSettings& f : every_filter()) {
    const Layers frame = noisy_frame(30, 30, 6);
    Layers bright = frame;
    for (const LayerName& l : {layer::direct, layer::indirect, layer::beauty})
      for (Plane* p : bright.add_rgb(l))
        for (int y = 0; y < 30; ++y)
          for (float& v : p->pixels(y)) v *= 2;
    const Layers a = apply_filter(f, frame, {Component::kIndirect, BackgroundRule::kBilateral, 1.0}, {});
    const Layers b = apply_filter(f, bright, {Component::kIndirect, BackgroundRule::kBilateral, 0.5}, {});
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 30; ++x) ASSERT_NEAR(b.at("R")(x, y), 2 * a.at("R")(x, y), 1e-4f) << label(f);
  }
}

TEST(EveryFilter, NeverMakesFlatNoiseWorse) {
  for (const FilterSettings& f : every_filter()) {
    Rng rng(8);
    std::vector<float> noise;
    for (int i = 0; i < 64 * 64 * 3; ++i) noise.push_back(static_cast<float>(0.35 + 0.1 * rng.uniform()));
    const Layers frame =
        frame_of(64, 64, [&](int x, int y, size_t c) { return noise[static_cast<size_t>(y * 64 + x) * 3 + c]; });
    const Layers out = apply_filter(f, frame, {}, {});
    double before = 0, after = 0;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) {
        const double truth = 0.4 + 0.01 * (x + y);
        before += std::pow(frame.at("G")(x, y) - truth, 2), after += std::pow(out.at("G")(x, y) - truth, 2);
      }
    EXPECT_LT(after, 0.25 * before) << label(f);
  }
}

TEST(EveryFilter, ComponentAllCleansTheBeautyAndIndirectKeepsTheDirect) {
  for (const FilterSettings& f : every_filter()) {
    Layers frame = noisy_frame(24, 24, 9);
    const Layers indirect = apply_filter(f, frame, {}, {});
    (*frame.add_rgb(layer::direct)[0])(12, 12) += 3.0f;
    const Layers changed = apply_filter(f, frame, {}, {});
    EXPECT_NEAR(changed.at("R")(12, 12) - indirect.at("R")(12, 12), 3.0f, 1e-5f);
    EXPECT_EQ(changed.at("R")(13, 12), indirect.at("R")(13, 12)) << "the direct component leaked into its neighbour";
    (*frame.add_rgb(layer::beauty)[0])(12, 12) += 3.0f;
    const Layers all = apply_filter(f, frame, {Component::kAll, BackgroundRule::kFilter, 1.0}, {});
    EXPECT_NE(all.at("R")(12, 12), changed.at("R")(12, 12)) << "filtering the sum is not filtering a part";
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
