// What is common to all filters and done once: components, carried layers, tiles, features, outliers, what is missing.

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

using test::chance;
using test::frame_of;
using test::noisy_frame;
using test::put;
using test::put_with_statistics;
using test::sampled_frame;

double worst_difference(const Layers& a, const Layers& b) {
  double worst = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x)
        worst = std::max<double>(worst, std::abs((*a.rgb(layer::beauty)[c])(x, y) - (*b.rgb(layer::beauty)[c])(x, y)));
  return worst;
}

double rms(const Layers& a, const test::Value& truth) {
  double sum = 0;
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x) sum += std::pow(a.at("G")(x, y) - truth(x, y, 1), 2);
  return std::sqrt(sum / (a.width() * a.height()));
}

TEST(CommonRules, TilesGiveTheSamePicture) {
  const Layers frame = noisy_frame(150, 90, 1);
  for (const FilterEntry* e : all_filters()) {
    // Draws by place, its tiles are held to the whole below; has tiles of its own, which oidn_test.cpp holds to the
    // whole.
    if (e->records == FilterEntry::Records::kNeeds || e->learned) continue;
    FilterSettings f(*e);
    if (f.entry().find("iterations")) f.set("iterations", "12");
    ApplyReport whole_report, report;
    const Layers whole = apply_filter(f, frame, {}, {}, &whole_report);
    ApplyOptions options;
    options.tile = 40;
    const Layers tiled = apply_filter(f, frame, options, {}, &report);
    EXPECT_EQ(whole_report.tiles, 1u);
    EXPECT_GE(report.tiles, f.entry().box ? 1u : 9u) << e->name;
    // Patches that claim one another in an order, and whole-frame means of a tile, differ a little.
    const bool ordered = e->name == "bayesian_collaborative";
    EXPECT_LT(worst_difference(whole, tiled), ordered ? 0.2 : 3e-4) << e->name;
  }
}

TEST(CommonRules, CarriedLayersAddUpToWhatCarriesThem) {
  Layers frame = noisy_frame(70, 50, 2);
  // The direct and indirect layers are the parts of the beauty.
  for (const FilterEntry* e : all_filters()) {
    ApplyOptions options;
    options.component = Component::kAll;
    options.carried = {layer::direct, layer::indirect};
    const FilterSettings f(*e);
    if (!e->carries) {
      if (e->records == FilterEntry::Records::kNeeds) continue;
      EXPECT_THROW(apply_filter(f, frame, options, {}), InputError) << e->name;
      continue;
    }
    const Layers out = apply_filter(f, frame, options, {});
    double worst = 0, changed = 0;
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < 50; ++y)
        for (int x = 0; x < 70; ++x) {
          const float direct = (*out.rgb(layer::direct)[c])(x, y), indirect = (*out.rgb(layer::indirect)[c])(x, y);
          worst = std::max<double>(worst, std::abs((*out.rgb(layer::beauty)[c])(x, y) - direct - indirect));
          changed += std::abs(indirect - (*frame.rgb(layer::indirect)[c])(x, y));
        }
    EXPECT_LT(worst, 3e-5) << e->name;
    EXPECT_GT(changed, 10) << e->name << " carried nothing";
  }
}

TEST(CommonRules, ApartIsEachComponentByItself) {
  const Layers frame = noisy_frame(40, 30, 3);
  const FilterSettings f = parse_filter("nl_means");
  ApplyOptions apart;
  apart.component = Component::kSeparate;
  const Layers both = apply_filter(f, frame, apart, {}), indirect = apply_filter(f, frame, {}, {});
  Layers swapped = frame;  // the direct component filtered alone: swap the names
  for (const std::string_view which :
       {std::string_view(), statistic::mean_variance, statistic::half_a, statistic::half_b})
    for (size_t c = 0; c < 3; ++c) {
      swapped.set(layer::indirect.channel_of(which, c), frame.at(layer::direct.channel_of(which, c)));
      swapped.set(layer::direct.channel_of(which, c), frame.at(layer::indirect.channel_of(which, c)));
    }
  const Layers direct = apply_filter(f, swapped, {}, {});
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
      ASSERT_NEAR(
          both.at("G")(x, y),
          indirect.at("G")(x, y) - frame.at("direct.G")(x, y) + direct.at("G")(x, y) - frame.at("indirect.G")(x, y),
          1e-5);
}

TEST(CommonRules, PartsThatAreKeptAddUpToThePicture) {
  const Layers frame = noisy_frame(40, 30, 3);
  for (const char* name : {"nl_means", "bilateral:average=linear"})
    for (const Component component : {Component::kAll, Component::kIndirect, Component::kSeparate}) {
      ApplyOptions options;
      options.component = component;
      const Layers plain = apply_filter(parse_filter(name), frame, options, {});
      EXPECT_FALSE(plain.has(layer::clean_direct) || plain.has(layer::clean_indirect)) << name;
      options.keep_parts = true;
      const Layers kept = apply_filter(parse_filter(name), frame, options, {});
      EXPECT_EQ(worst_difference(plain, kept), 0) << name;
      EXPECT_EQ(kept.has(layer::clean_direct), component == Component::kSeparate) << name;
      EXPECT_EQ(kept.has(layer::clean_indirect), component != Component::kAll) << name;
      if (component == Component::kAll) continue;
      const Plane& direct = component == Component::kSeparate ? kept.at("clean_direct.G") : frame.at("direct.G");
      for (int y = 0; y < 30; ++y)
        for (int x = 0; x < 40; ++x)
          ASSERT_NEAR(kept.at("G")(x, y), direct(x, y) + kept.at("clean_indirect.G")(x, y), 1e-5) << name;
    }
}

/// A frame whose features carry nothing: each constant, absent, or noise.
Layers without_signal_in_features(Layers frame, const std::string& how) {
  Layers out(frame.width(), frame.height());
  for (const auto& [name, plane] : frame.channels()) {
    bool feature = false;
    for (const LayerName& l : FeaturePlan::sources()) feature |= name.starts_with(std::string(l.name) + ".");
    if (!feature) out.set(name, plane);
  }
  if (how == "absent") return out;
  for (const LayerName& l : {layer::transmittance, layer::gradient_transmittance_weighted, layer::albedo}) {
    const auto noise = [&](uint64_t purpose) {
      return [purpose, &how](int x, int y, size_t c) {
        return how == "constant" ? 0.5f : static_cast<float>(0.5 + 0.1 * test::normal(x, y, 1000 * purpose + c));
      };
    };
    put(out, l, "", noise(1));
    put(out, l, statistic::half_a, noise(2));
    put(out, l, statistic::half_b, noise(3));
    put(out, l, statistic::mean_variance, [&](int, int, size_t) { return how == "constant" ? 0.0f : 0.01f; });
  }
  return out;
}

TEST(CommonRules, FeaturesThatSayNothingNeverMakeItWorseThanColourAlone) {
  const test::Value truth = [](int x, int y, size_t) {
    return 0.5f + 0.3f * std::sin(0.15f * static_cast<float>(x)) + (y > 30 ? 0.4f : 0.0f);
  };
  const Layers frame = sampled_frame(80, 60, 16, 0.6, 4, truth);
  for (const FilterEntry* e : all_filters()) {
    FilterSettings f(*e);
    if (e->find("feature-strength")) f.set("feature-strength", "0.6");
    if (e->find("network")) f.set("network", "none");  // whether its weights are there depends on the machine
    if (!f.uses_features()) continue;
    if (e->needs_features) {
      for (const std::string how : {"absent", "constant", "noise"})
        EXPECT_THROW(apply_filter(f, without_signal_in_features(frame, how), {}, {}), InputError) << e->name << how;
      continue;
    }
    ApplyOptions alone;
    alone.features = {"none"};
    const double color =
        rms(apply_filter(f, without_signal_in_features(frame, "absent"), alone, {}),
            [&](int x, int y, size_t c) { return truth(x, y, c) + 0.01f * static_cast<float>(x + y); });
    for (const std::string how : {"absent", "constant", "noise"}) {
      ApplyReport report;
      const Layers out = apply_filter(f, without_signal_in_features(frame, how), {}, {}, &report);
      EXPECT_LE(rms(out, [&](int x, int y, size_t c) { return truth(x, y, c) + 0.01f * static_cast<float>(x + y); }),
                1.0001 * color)
          << e->name << " " << how;
      ASSERT_FALSE(report.notes.empty());
      const std::string& note = report.notes.front();
      EXPECT_NE(note.find(how == "absent"     ? "(not recorded)"
                          : how == "constant" ? "(constant)"
                                              : "(noisier than its signal)"),
                std::string::npos)
          << note;
    }
  }
}

TEST(CommonRules, FeaturesAreChosenByName) {
  const Layers frame = noisy_frame(30, 20, 5);
  ApplyOptions options;
  options.features = {"opacity"};
  ApplyReport report;
  apply_filter(parse_filter("guided"), frame, options, {}, &report);
  EXPECT_EQ(report.notes.front(), "features: opacity");
  options.features = {"opacty"};
  try {
    apply_filter(parse_filter("guided"), frame, options, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("no feature 'opacty'; did you mean 'opacity'?"), std::string::npos)
        << error.what();
  }
}

TEST(CommonRules, AFiltersOwnFeaturesGiveWayToTheCallersAndToWhatThereIs) {
  const Layers frame = noisy_frame(30, 20, 5);
  Layers without_opacity(30, 20);
  for (const auto& [name, plane] : frame.channels())
    if (!name.starts_with("transmittance.")) without_opacity.set(name, plane);
  const auto note = [](const std::string& filter, const Layers& layers, const std::vector<std::string>& named) {
    ApplyOptions options;
    options.features = named;
    ApplyReport report;
    apply_filter(parse_filter(filter), layers, options, {}, &report);
    return report.notes.front();
  };
  EXPECT_EQ(note("guided:feature-set=opacity", frame, {}), "features: opacity");
  EXPECT_TRUE(note("guided:feature-set=all", frame, {}).starts_with("features: opacity, gradient"));
  EXPECT_TRUE(note("guided:feature-set=scalar", frame, {}).starts_with("features: opacity; without"));
  EXPECT_TRUE(note("guided:feature-set=opacity", frame, {"gradient"}).starts_with("features: gradient"));
  EXPECT_TRUE(note("guided:feature-set=opacity", without_opacity, {}).starts_with("features: gradient"));
}

TEST(CommonRules, OutliersAreLimitedAndTheirLightIsAccountedFor) {
  Layers frame = sampled_frame(60, 60, 64, 0.2, 6, [](int, int, size_t) { return 1.0f; });
  // One bucket of one pixel met the sun.
  const float extra = 400;
  for (const size_t c : {0u, 1u, 2u}) {
    (*frame.add_rgb(layer::indirect)[c])(30, 30) += extra / 8;
    (*frame.add_rgb(layer::indirect, statistic::buckets[3])[c])(30, 30) += extra;
    (*frame.add_rgb(layer::indirect, statistic::half_b)[c])(30, 30) += extra / 4;
    (*frame.add_rgb(layer::indirect, statistic::mean_variance)[c])(30, 30) += extra * extra / 64;
  }
  const auto light = [](const Layers& l) {
    double sum = 0;
    for (int y = 0; y < 60; ++y)
      for (int x = 0; x < 60; ++x) sum += l.at("G")(x, y);
    return sum;
  };
  const FilterSettings f = parse_filter("gaussian");
  ApplyOptions keep, clamp, redistribute;
  for (ApplyOptions* o : {&keep, &clamp, &redistribute}) o->background = BackgroundRule::kFilter;
  keep.outliers = Outliers::kKeep;
  clamp.outliers = Outliers::kClamp;
  redistribute.outliers = Outliers::kRedistribute;
  ApplyReport report;
  const Layers kept = apply_filter(f, frame, keep, {}), clamped = apply_filter(f, frame, clamp, {}, &report),
               moved = apply_filter(f, frame, redistribute, {});
  EXPECT_NEAR(light(kept) - light(clamped), 50, 1.5);
  EXPECT_NEAR(light(moved), light(kept), 0.5);
  EXPECT_LT(clamped.at("G")(30, 30), 2.0) << "0.6 of it is direct light";
  EXPECT_LT(moved.at("G")(30, 30), 2.6);
  EXPECT_NE(report.notes.back().find("1 outlier pixels were limited"), std::string::npos) << report.notes.back();
}

TEST(CommonRules, WhatIsMissingIsNamedWithTheWayToGetIt) {
  const Layers frame = noisy_frame(20, 20, 7);
  const auto without = [&](const std::string& part) {
    Layers out(20, 20);
    for (const auto& [name, plane] : frame.channels())
      if (name.find(part) == std::string::npos) out.set(name, plane);
    return out;
  };
  const auto message = [](const std::string& filter, const Layers& f, const ApplyOptions& options = {}) {
    try {
      apply_filter(parse_filter(filter), f, options, {});
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const auto holds = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  };
  Layers bare = without("mean_variance");
  for (const std::string part : {"half_", "bucket_"}) {
    Layers less(20, 20);
    for (const auto& [name, plane] : bare.channels())
      if (name.find(part) == std::string::npos) less.set(name, plane);
    bare = less;
  }
  EXPECT_TRUE(holds(message("wavelet", bare),
                    "needs the variance of 'indirect' (channel indirect.mean_variance.R and its like)"))
      << message("wavelet", bare);
  EXPECT_TRUE(holds(message("wavelet", bare), "--noise spatial"));
  EXPECT_EQ(message("wavelet", without("mean_variance")), "") << "the halves tell it too";
  ApplyOptions spatial;
  spatial.noise = NoiseSource::kSpatial;
  EXPECT_EQ(message("wavelet", bare, spatial), "");
  EXPECT_EQ(message("nl_means:buffers=one", bare, spatial), "");
  EXPECT_TRUE(holds(message("nl_means", bare, spatial), "buffers=one works without"));
  EXPECT_TRUE(holds(message("nfor", without("half_")), "the two half images"));
  EXPECT_TRUE(holds(message("welch", without("bucket_")), "--buckets"));
  EXPECT_TRUE(holds(message("virtual_flash:guide=flash", without("flash")), "needs the layer 'flash'"));
  EXPECT_EQ(message("virtual_flash:guide=signal", without("flash")), "");
  EXPECT_TRUE(holds(message("random_parameter", frame), "--records OUT.records"));
  EXPECT_TRUE(holds(message("gaussian:choose=per-pixel", bare), "--noise spatial"));
  ApplyOptions limit;
  limit.outliers = Outliers::kClamp;
  EXPECT_TRUE(holds(message("gaussian", bare, limit), "limiting outliers needs the variance of 'indirect'"));
  limit.carried = {layer::direct};
  EXPECT_TRUE(holds(message("gaussian", frame, limit), "use one of both"));
  ApplyOptions carry;
  carry.carried = {layer::emission};
  EXPECT_TRUE(holds(message("guided", frame, carry), "no layer 'emission' to carry along"));
  EXPECT_TRUE(holds(message("nfor", frame, carry), "these can: a_trous"));
}

TEST(CommonRules, TheRangeSigmaFollowsTheMeasuredNoise) {
  const Layers frame = sampled_frame(64, 56, 16, 0.4, 6, [](int, int, size_t) { return 0.5f; });
  for (const std::string name : {"bilateral", "extended_bilateral", "gradient_kernel", "trilateral"}) {
    ApplyReport report;
    const Layers automatic = apply_filter(parse_filter(name + ":noise-factor=3"), frame, {}, {}, &report);
    ASSERT_FALSE(report.notes.empty());
    double noise = 0;
    for (const std::string& note : report.notes)
      if (const size_t at = note.find("noise of 'indirect': "); at != std::string::npos)
        noise = std::stod(note.substr(21));
    EXPECT_GT(noise, 1) << name;
    const Layers given = apply_filter(parse_filter(name + ":sigma-range=" + std::to_string(3 * noise)), frame, {}, {});
    EXPECT_LT(worst_difference(automatic, given), 2e-3) << name << ": the note has three digits";
    EXPECT_GT(worst_difference(automatic, apply_filter(parse_filter(name), frame, {}, {})), 5e-3) << name;
  }
}

TEST(CommonRules, OneSampleAndUnequalCountsRun) {
  Layers one = sampled_frame(40, 30, 1, 0.3, 8, [](int, int, size_t) { return 1.0f; });
  Layers unequal = sampled_frame(40, 30, 16, 0.3, 8, [](int, int, size_t) { return 1.0f; });
  put(unequal, layer::sample_count, "", [](int x, int, size_t) { return x < 20 ? 1.0f : 31.0f; });
  for (const FilterEntry* e : all_filters()) {
    if (e->records == FilterEntry::Records::kNeeds || e->learned) continue;
    for (const Layers* frame : {&one, &unequal}) {
      const Layers out = apply_filter(FilterSettings(*e), *frame, {}, {});
      for (const auto& [name, plane] : out.channels()) EXPECT_EQ(count_not_finite(plane), 0u) << e->name << " " << name;
    }
  }
}

TEST(CommonRules, RandomParameterFilteringReadsTheRecordsOfItsFrameOnly) {
  const Layers frame = noisy_frame(30, 20, 9);
  test::Records records(frame), other(noisy_frame(31, 20, 9));
  ApplyOptions options;
  options.records = &*other.reader;
  FilterSettings f = parse_filter("random_parameter:largest-neighborhood=100");
  try {
    apply_filter(f, frame, options, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("31 x 20 pixels, the frame has 30 x 20"), std::string::npos)
        << error.what();
  }
  options.records = &*records.reader;
  const Layers whole = apply_filter(f, frame, options, {});
  options.tile = 12;
  EXPECT_LT(worst_difference(whole, apply_filter(f, frame, options, {})), 1e-4) << "the apron holds all four passes";
}

}  // namespace
}  // namespace brume
