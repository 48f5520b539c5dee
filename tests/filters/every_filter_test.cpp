// What every filter must survive (FILTERS.md section F), looped over the registry: each filter at its defaults and with
// every choice of its options.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>

#include "base/error.h"
#include "base/rng.h"
#include "filters/apply.h"
#include "filters/registry.h"
#include "tests/support/files.h"

namespace brume {
namespace {

std::vector<FilterSettings> every_filter() {
  std::vector<FilterSettings> list;
  const auto add = [&](const FilterEntry& e) -> FilterSettings& {
    list.emplace_back(e);
    // What is tested here does not depend on how many samples a neighbourhood has, the time does.
    if (e.name == "random_parameter") list.back().set("largest-neighborhood", "120");
    if (e.name == "anisotropic_diffusion") list.back().set("iterations", "25");
    return list.back();
  };
  for (const FilterEntry* e : all_filters()) {
    add(*e);
    const FilterSettings defaults(*e);
    for (const Parameter& p : e->parameters)
      for (const std::string& choice : p.choices) {
        if (Parameter::text(defaults.get(p)) == choice) continue;
        add(*e).set(p.name, choice);
        if (e->name == "extended_bilateral" && (p.name == "hue" || p.name == "logarithm" || p.name == "average")) {
          list.emplace_back(list.back());
          list.back().set("domain", "log-luminance");
        }
      }
    if (e->find("feature-strength")) add(*e).set("feature-strength", "0.6");
  }
  return list;
}

std::string label(const FilterSettings& f) {
  return f.entry().name + " " + f.text();
}

/// A number in [0, 1) for each pixel and purpose.
double chance(int x, int y, uint64_t purpose) {
  return Rng(hash_combine(hash_combine(purpose, static_cast<uint64_t>(x)), static_cast<uint64_t>(y))).uniform();
}

/// Whether a pixel's k-th bucket lies above its mean: every other one.
bool is_up(int x, int y, size_t c, size_t k) {
  return (k + (chance(x, y, 14 + c) < 0.5)) % 2 == 0;
}

using Value = std::function<float(int, int, size_t)>;

void put(Layers& frame, const LayerName& l, std::string_view statistic, const Value& value) {
  for (size_t c = 0; c < l.channels.size(); ++c) {
    Plane& p = frame.add(l.channel_of(statistic, c));
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) p(x, y) = value(x, y, c);
  }
}

/// A layer with statistics that agree with one another: eight buckets around the mean, whose spread is the variance.
/// @param spread  of the buckets and halves instead, as a variance
void put_with_statistics(Layers& frame, const LayerName& l, double variance, const Value& value, double spread = -1) {
  if (spread < 0) spread = variance;
  put(frame, l, "", value);
  put(frame, l, statistic::mean_variance, [&](int, int, size_t) { return static_cast<float>(variance); });
  const auto bucket = [&](int x, int y, size_t c, size_t k) {
    return value(x, y, c) + static_cast<float>(std::sqrt(7 * spread)) * (is_up(x, y, c, k) ? 1.0f : -1.0f);
  };
  for (size_t k = 0; k < 8; ++k)
    put(frame, l, statistic::buckets[k], [&](int x, int y, size_t c) { return bucket(x, y, c, k); });
  const float half = static_cast<float>(std::sqrt(spread));
  for (const auto& [name, sign] : {std::pair(statistic::half_a, 1.0f), {statistic::half_b, -1.0f}})
    put(frame, l, name, [&, sign = sign](int x, int y, size_t c) {
      return value(x, y, c) + sign * (chance(x, y, 18 + c) < 0.5 ? half : -half);
    });
}

Layers frame_of(int width, int height, const Value& indirect, double variance = 0.013, double spread = -1) {
  Layers frame(width, height);
  put_with_statistics(frame, layer::indirect, variance, indirect, spread);
  put_with_statistics(frame, layer::direct, 1e-6, [](int x, int y, size_t) { return 0.01f * static_cast<float>(x + y); });
  put_with_statistics(frame, layer::beauty, variance,
                      [&](int x, int y, size_t c) { return indirect(x, y, c) + 0.01f * static_cast<float>(x + y); });
  for (const LayerName& l : {layer::gradient, layer::gradient_transmittance_weighted})
    put(frame, l, "", [](int x, int y, size_t c) {
      return std::array{0.6f, 0.8f * (x % 2 ? 1.0f : -1.0f), y % 5 ? 0.1f : 0.0f}[c];
    });
  put(frame, layer::coverage, "", [](int x, int, size_t) { return x % 7 == 0 ? 0.0f : 1.0f; });
  put(frame, layer::alpha, "", [](int x, int, size_t) { return x % 7 == 0 ? 0.0f : 0.5f; });
  put_with_statistics(frame, layer::transmittance, 1e-5,
                      [](int x, int, size_t) { return 0.5f + 0.4f * std::sin(0.2f * static_cast<float>(x)); });
  put_with_statistics(frame, layer::flash, 1e-5,
                      [](int x, int y, size_t) { return 0.5f + 0.4f * std::sin(0.2f * static_cast<float>(x - y)); });
  put(frame, layer::sample_count, "", [](int, int, size_t) { return 8.0f; });
  return frame;
}

/// The frame's buckets as recorded samples, each with random numbers on which its colour depends.
struct Records {
  test::TemporaryFolder folder;
  std::optional<RecordReader> reader;

  explicit Records(const Layers& frame) {
    RecordLayout layout;
    layout.width = frame.width(), layout.height = frame.height(), layout.samples = 8;
    layout.fields = {{"film", 2},        {"lens", 2},       {"time", 1},    {"flight_1", 1},         {"flight_2", 1},
                     {"direction_1", 3}, {"direction_2", 3}, {"light_1", 1}, {"light_uv_1", 2},       {"position_1", 3},
                     {"position_2", 3},  {"surface_gradient", 3}, {"gradient_1", 3}, {"albedo", 3},   {"density_1", 1},
                     {"light_transmittance_1", 1}, {"normal", 3}, {"flags", 1}, {"unscattered", 3},   {"single", 3},
                     {"indirect", 3}};
    const auto number = [&](const RecordLayout::Field& field, size_t c, int x, int y, size_t k) {
      const auto random = [&](uint64_t i) { return static_cast<float>(chance(x, y, 100 + 16 * i + k)); };
      const auto bucket = [&](const LayerName& l) { return frame.at(l.channel_of(statistic::buckets[k], c))(x, y); };
      if (field.name == "film") return static_cast<float>(c == 0 ? x : y) + random(c);
      if (field.name == "flight_1") return 0.5f * (random(2) + (is_up(x, y, 0, k) ? 1.0f : 0.0f));
      if (field.name == "direction_1" || field.name == "light_uv_1") return random(3 + c);
      if (field.name == "position_1") return 0.1f * static_cast<float>(x) + random(6 + c);
      if (field.name == "unscattered") return bucket(layer::direct);
      if (field.name == "indirect") return bucket(layer::indirect);
      return 0.0f;
    };
    const auto path = folder.path() / "x.records";
    RecordWriter writer(path, layout);
    for (int tile = 0; tile < layout.tile_count(); ++tile) {
      std::vector<float> block;
      const RecordLayout::Bounds b = layout.bounds(tile);
      for (int y = b.y0; y < b.y1; ++y)
        for (int x = b.x0; x < b.x1; ++x)
          for (size_t k = 0; k < 8; ++k)
            for (const RecordLayout::Field& field : layout.fields)
              for (size_t c = 0; c < static_cast<size_t>(field.components); ++c) block.push_back(number(field, c, x, y, k));
      writer.write(tile, block);
    }
    writer.commit();
    reader.emplace(path);
  }
};

/// Runs a filter, with records where it needs them.
Layers apply(const FilterSettings& f, const Layers& frame, ApplyOptions options = {}, const Task& task = {},
             ApplyReport* report = nullptr) {
  std::optional<Records> records;
  if (f.entry().records == FilterEntry::Records::kNeeds) options.records = &*records.emplace(frame).reader;
  return apply_filter(f, frame, options, task, report);
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
      // The released program of random parameter filtering cuts samples off at ten times white.
      if (value > 10 && f.text().find("preset=release") != std::string::npos) continue;
      const Layers frame =
          frame_of(30, 20, [value](int, int, size_t c) { return value * (1.0f + 0.2f * static_cast<float>(c)); }, 0.013, 0);
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
  for (const FilterSettings& f : every_filter())
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -1.0f, 1e30f}) {
      Layers frame = noisy_frame(64, 48, 2);
      const Layers clean = apply(f, frame, {}, {});
      (*frame.add_rgb(layer::indirect)[1])(20, 24) = bad;
      ApplyReport report;
      const Layers out = apply(f, frame, {}, {}, &report);
      expect_all_finite(out, label(f));
      EXPECT_EQ(report.repaired_pixels, std::isfinite(bad) ? 0u : 1u);
      const int reach = f.apron() + (f.entry().can_use_statistics > Statistics::kNone ? kNoiseReach : 0);
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
    expect_all_finite(apply(f, frame, {}, {}, &report), label(f));
    EXPECT_EQ(report.repaired_pixels, 200u);
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
    // Random numbers by the pixel's place do not turn with the picture, nor does the order in which patches claim pixels.
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
    const Layers frame =
        frame_of(64, 64, [&](int x, int y, size_t c) { return noise[static_cast<size_t>(y * 64 + x) * 3 + c]; }, 0.01 / 12);
    const Layers out = apply(f, frame, {}, {});
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
