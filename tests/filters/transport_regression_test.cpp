// Regression on guides: pictures whose truth, noise and guides are known.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/error.h"
#include "base/rng.h"
#include "filters/api/recommend.h"
#include "filters/api/registry.h"
#include "filters/regression/transport/guide_check.h"
#include "filters/inputs/guide_layers.h"
#include "filters/regression/transport/stacking.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

using test::chance;
using test::normal;
using test::put;
using test::Value;

constexpr int kWidth = 120, kHeight = 100;

/// A round cloud whose rim is thin.
float opacity(int x, int y) {
  const double r = std::hypot(x - 60.0, y - 50.0) / 44;
  return static_cast<float>(std::clamp(1.4 - 1.4 * r * r, 0.0, 1.0));
}

float sun(int x, int y) {
  return opacity(x, y) * (0.4f + 0.3f * std::sin(0.13f * static_cast<float>(x) + 0.05f * static_cast<float>(y)));
}

float sky(int x, int y) {
  return opacity(x, y) * (0.3f + 0.2f * std::cos(0.09f * static_cast<float>(y)));
}

float twice(int x, int y) {
  return sun(x, y) * (0.5f + 0.3f * std::cos(0.21f * static_cast<float>(x - y)));
}

float constant_sky(int, int, size_t c) {
  return std::array{0.2f, 0.3f, 0.4f}[c];
}

float direct_truth(int x, int y, size_t c) {
  return (1 - opacity(x, y)) * constant_sky(x, y, c) + sun(x, y) + 0.5f * constant_sky(x, y, c) * sky(x, y);
}

/// In the span of the guides.
float indirect_truth(int x, int y, size_t c) {
  return 0.8f * twice(x, y) + constant_sky(x, y, c) * (0.7f * sky(x, y) + 0.3f * opacity(x, y));
}

/// Not in the span: an edge that no guide knows.
float unknown_truth(int x, int y, size_t c) {
  return indirect_truth(x, y, c) * (x > 55 ? 1.3f : 1.0f);
}

void put_guides(Layers& frame) {
  put(frame, guide_layer::opacity, "", [](int x, int y, size_t) { return opacity(x, y); });
  put(frame, {"guide.single.sun", "Y", ""}, "", [](int x, int y, size_t) { return sun(x, y); });
  put(frame, {"guide.single.sky", "Y", ""}, "", [](int x, int y, size_t) { return sky(x, y); });
  put(frame, {"guide.multiple.sun_order2", "Y", ""}, "", [](int x, int y, size_t) { return twice(x, y); });
  put(frame, guide_layer::background, "",
      [](int x, int y, size_t c) { return (1 - opacity(x, y)) * constant_sky(x, y, c); });
}

/// A layer whose two halves are the truth times 1 + deviation * a normal deviate where the medium is; all three colours
/// err alike, as they do where light is grey.
void put_noisy(Layers& frame, const LayerName& l, double deviation, uint64_t seed, const Value& truth) {
  const auto half = [&](uint64_t which) {
    return [=](int x, int y, size_t c) {
      const double noise =
          opacity(x, y) > 0 ? std::sqrt(2.0) * deviation * normal(x, y, mix64(100 * seed + which) / 4) : 0.0;
      return truth(x, y, c) * static_cast<float>(1 + noise);
    };
  };
  const Value a = half(1), b = half(2);
  put(frame, l, statistic::half_a, a);
  put(frame, l, statistic::half_b, b);
  put(frame, l, "", [&](int x, int y, size_t c) { return 0.5f * (a(x, y, c) + b(x, y, c)); });
}

Layers make_frame(double deviation, uint64_t seed, const Value& indirect = indirect_truth, bool guided = true) {
  Layers frame(kWidth, kHeight);
  put_noisy(frame, layer::direct, deviation, seed, direct_truth);
  put_noisy(frame, layer::indirect, deviation, seed + 1, indirect);
  const RgbPlanes d = frame.rgb(layer::direct), i = frame.rgb(layer::indirect);
  put(frame, layer::beauty, "", [&](int x, int y, size_t c) { return (*d[c])(x, y) + (*i[c])(x, y); });
  put(frame, layer::sample_count, "", [](int, int, size_t) { return 4.0f; });
  if (guided) put_guides(frame);
  return frame;
}

ApplyOptions whole_picture() {
  ApplyOptions options;
  options.component = Component::kAll;
  return options;
}

Layers clean(const Layers& frame, const Task& task = {}, ApplyReport* report = nullptr, int tile = 0) {
  ApplyOptions options = whole_picture();
  options.tile = tile;
  return apply_filter(FilterSettings(find_filter("transport_regression")), frame, options, task, report);
}

/// Root mean square over the medium of a picture less the truth.
double error_of(const Layers& frame, const Value& indirect = indirect_truth) {
  double sum = 0, count = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        if (!(opacity(x, y) > 0)) continue;
        const double e = (*frame.rgb(layer::beauty)[c])(x, y) - (direct_truth(x, y, c) + indirect(x, y, c));
        sum += e * e;
        ++count;
      }
  return std::sqrt(sum / count);
}

double sum_of(const RgbPlanes& p) {
  double sum = 0;
  for (const Plane* plane : p)
    for (int y = 0; y < plane->height(); ++y)
      for (const float v : plane->pixels(y)) sum += static_cast<double>(v);
  return sum;
}

void expect_the_same_bits(const Layers& a, const Layers& b) {
  for (const auto& [name, plane] : a.channels())
    for (int y = 0; y < plane.height(); ++y)
      for (int x = 0; x < plane.width(); ++x) ASSERT_EQ(plane(x, y), b.at(name)(x, y)) << name << " " << x << " " << y;
}

TEST(TransportRegression, NoiseFallsFifteenfoldWhereGuidesExplainThePicture) {
  const Layers frame = make_frame(0.5, 1);
  EXPECT_LT(error_of(clean(frame)), error_of(frame) / 15);
}

// With half images and, judged by pixels left out, without.
TEST(GuideCheck, FindsGuidesOfAnotherPlaceAndNeverThoseOfTheFrame) {
  for (const double deviation : {0.02, 0.1, 0.3, 1.0})
    for (const Value& truth : {Value(indirect_truth), Value(unknown_truth)})
      for (const bool halves : {true, false}) {
        Layers frame = make_frame(deviation, 1, truth);
        for (const std::string_view which : {statistic::half_a, statistic::half_b})
          if (halves)
            put(frame, layer::beauty, which, [&](int x, int y, size_t c) {
              return (*frame.rgb(layer::direct, which)[c])(x, y) + (*frame.rgb(layer::indirect, which)[c])(x, y);
            });
        EXPECT_FALSE(check_guides(frame, {}).misleads()) << deviation << " halves " << halves;
        Layers shifted = frame;
        for (const auto& [name, plane] : frame.channels())
          if (is_guide(name))
            for (int y = 0; y < kHeight; ++y)
              for (int x = 0; x < kWidth; ++x) (*shifted.find(name))(x, y) = plane((x + 40) % kWidth, y);
        EXPECT_TRUE(check_guides(shifted, {}).misleads()) << deviation << " halves " << halves;
      }
}

TEST(TransportRegression, APictureWithoutNoiseIsReproduced) {
  for (const Value& truth : {Value(indirect_truth), Value(unknown_truth)}) {
    const Layers frame = make_frame(0, 1, truth);
    EXPECT_LT(error_of(clean(frame), truth), 3e-4);
  }
}

TEST(TransportRegression, AWhiteFurnaceStaysWhite) {
  Layers frame = make_frame(0, 1);
  for (const std::string_view which : {std::string_view(), statistic::half_a, statistic::half_b}) {
    put(frame, layer::direct, which, [](int, int, size_t) { return 0.25f; });
    put(frame, layer::indirect, which, [](int, int, size_t) { return 0.75f; });
  }
  put(frame, guide_layer::opacity, "", [](int, int, size_t) { return 1.0f; });
  const Layers out = clean(frame);
  for (const Plane* p : out.rgb(layer::beauty))
    for (int y = 0; y < kHeight; ++y)
      for (const float v : p->pixels(y)) ASSERT_NEAR(v, 1.0f, 2e-5f);
}

TEST(TransportRegression, GuidesOfNothingAndOfNoiseDoNoHarm) {
  const Layers frame = make_frame(0.3, 3);
  for (const bool noise : {false, true}) {
    Layers useless = frame;
    for (const std::string& name : frame.names())
      if (is_guide(name))
        for (int y = 0; y < kHeight; ++y)
          for (int x = 0; x < kWidth; ++x)
            useless.add(name)(x, y) =
                noise ? static_cast<float>(
                            normal(x, y, mix64(900 + name.size() + static_cast<uint64_t>(name.back())) / 4))
                      : 0.0f;
    EXPECT_LT(error_of(clean(useless)), 1.02 * error_of(frame)) << noise;
  }
}

TEST(TransportRegression, ColumnsThatRepeatOthersDoNoHarm) {
  const Layers frame = make_frame(0.5, 4);
  Layers more = frame;
  put(more, {"guide.multiple.sum", "Y", ""}, "", [](int x, int y, size_t) { return sun(x, y) + 2 * twice(x, y); });
  put(more, {"guide.multiple.again", "Y", ""}, "", [](int x, int y, size_t) { return 3 * twice(x, y); });
  put(more, {"guide.multiple.nothing", "Y", ""}, "", [](int, int, size_t) { return 0.0f; });
  EXPECT_NEAR(error_of(clean(more)), error_of(clean(frame)), 0.25 * error_of(clean(frame)));
}

TEST(TransportRegression, MoreSamplesAlwaysHelpAndTheResultIsNeverAboveItsInput) {
  double last = 1e9;
  for (const double deviation : {0.4, 0.1, 0.025, 0.006, 0.0015}) {
    const Layers frame = make_frame(deviation, 5, unknown_truth);
    const double before = error_of(frame, unknown_truth), after = error_of(clean(frame), unknown_truth);
    EXPECT_LT(after, before) << deviation;
    EXPECT_LT(after, last) << deviation;
    last = after;
  }
}

TEST(TransportRegression, FirefliesVanishAndTheirLightStays) {
  const Layers calm = make_frame(0.3, 6);
  Layers frame = calm;
  for (int k = 0; k < 12; ++k) {
    const int x = 30 + static_cast<int>(60 * chance(k, 0, 1)), y = 25 + static_cast<int>(50 * chance(k, 1, 1));
    for (size_t c = 0; c < 3; ++c) {
      frame.add(layer::indirect.channel_of(statistic::half_a, c))(x, y) += 40.0f;
      frame.add(layer::indirect.channel(c))(x, y) += 20.0f;
      frame.add(layer::beauty.channel(c))(x, y) += 20.0f;
    }
  }
  const Layers out = clean(frame);
  EXPECT_LT(error_of(out), 0.1 * error_of(frame));
  EXPECT_NEAR(sum_of(out.rgb(layer::beauty)) / sum_of(frame.rgb(layer::beauty)), 1.0, 0.02);
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) ASSERT_LT((*out.rgb(layer::beauty)[c])(x, y), 2.5f);
}

TEST(TransportRegression, PicturesThatNoGuideKnowsAreNeverMadeWorse) {
  const std::pair<const char*, Value> pictures[] = {
      {"bright wisp",
       [](int x, int y, size_t c) { return indirect_truth(x, y, c) + (std::abs(x - y - 8) < 2 ? 3.0f : 0.0f); }},
      {"checker", [](int x, int y, size_t c) { return indirect_truth(x, y, c) * ((x + y) % 2 ? 1.6f : 0.4f); }},
      {"filaments",
       [](int x, int y, size_t c) { return indirect_truth(x, y, c) * ((x + 2 * y) % 9 == 0 ? 3.0f : 1.0f); }},
      {"holes", [](int x, int y, size_t c) { return chance(x, y, 77) < 0.1 ? 0.0f : indirect_truth(x, y, c); }},
  };
  for (const auto& [name, truth] : pictures)
    for (const double deviation : {0.5, 0.1, 0.02}) {
      const Layers frame = make_frame(deviation, 30, truth);
      EXPECT_LT(error_of(clean(frame), truth), 1.02 * error_of(frame, truth)) << name << " " << deviation;
    }
}

TEST(TransportRegression, TheMeanStays) {
  double ratio = 0;
  for (uint64_t seed = 10; seed < 16; ++seed) {
    const Layers frame = make_frame(0.5, seed, unknown_truth);
    ratio += sum_of(clean(frame).rgb(layer::beauty)) / sum_of(frame.rgb(layer::beauty)) / 6;
  }
  EXPECT_NEAR(ratio, 1.0, 0.003);
}

TEST(TransportRegression, TheEstimatedErrorIsTheTrueOne) {
  double estimated = 0, truth = 0;
  for (uint64_t seed = 20; seed < 24; ++seed) {
    const Layers out = clean(make_frame(0.4, seed, unknown_truth));
    double squares = 0, count = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if (opacity(x, y) > 0) {
          squares += std::pow(out.at("clean_error.Y")(x, y), 2);
          ++count;
        }
    estimated += squares / count;
    truth += std::pow(error_of(out, unknown_truth), 2);
  }
  EXPECT_NEAR(std::sqrt(estimated / truth), 1.0, 0.25);
}

/// Whether no medium shows at a pixel or beside it.
bool is_away(int x, int y) {
  for (int v = y - 1; v <= y + 1; ++v)
    for (int u = x - 1; u <= x + 1; ++u)
      if (opacity(u, v) > 0) return false;
  return true;
}

TEST(TransportRegression, WhereThereIsNeitherMediumNorNoisePixelsStay) {
  const Layers frame = make_frame(0.5, 7), out = clean(frame);
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if (is_away(x, y)) {
          ASSERT_EQ((*out.rgb(layer::beauty)[c])(x, y), (*frame.rgb(layer::beauty)[c])(x, y));
        }
}

TEST(TransportRegression, NoiseBesideTheMediumIsCleaned) {
  // As of a sky that a lens blurs.
  Layers frame = make_frame(0.5, 7);
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        if (opacity(x, y) > 0) continue;
        const float a = static_cast<float>(0.1 * normal(x, y, 31)), b = static_cast<float>(0.1 * normal(x, y, 32));
        const float sky = constant_sky(x, y, c);
        (*frame.find(layer::direct.channel_of(statistic::half_a, c)))(x, y) = sky + a;
        (*frame.find(layer::direct.channel_of(statistic::half_b, c)))(x, y) = sky + b;
        (*frame.find(layer::direct.channel(c)))(x, y) = sky + 0.5f * (a + b);
        (*frame.find(layer::beauty.channel(c)))(x, y) = sky + 0.5f * (a + b);
      }
  const Layers out = clean(frame);
  double before = 0, after = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if (is_away(x, y)) {
          const float sky = constant_sky(x, y, c);
          before += std::pow((*frame.rgb(layer::beauty)[c])(x, y) - sky, 2);
          after += std::pow((*out.rgb(layer::beauty)[c])(x, y) - sky, 2);
        }
  EXPECT_LT(after, 0.1 * before);
}

TEST(TransportRegression, ThePartsAreKeptAndSumToThePicture) {
  const Layers out = clean(make_frame(0.5, 8));
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        ASSERT_NEAR((*out.rgb(layer::clean_direct)[c])(x, y) + (*out.rgb(layer::clean_indirect)[c])(x, y),
                    (*out.rgb(layer::beauty)[c])(x, y), 1e-6f);
}

TEST(TransportRegression, WithoutHalvesFitsAreJudgedByPixelsLeftOut) {
  Layers frame(kWidth, kHeight);
  const Layers full = make_frame(0.7, 9);
  for (const auto& [name, plane] : full.channels())
    if (name.find("half") == std::string::npos) frame.set(name, plane);
  put(frame, layer::sample_count, "", [](int, int, size_t) { return 1.0f; });
  ApplyReport report;
  const double error = error_of(clean(frame, {}, &report));
  EXPECT_LT(error, 0.1 * error_of(frame));
  EXPECT_LT(error, 1.1 * error_of(clean(full)));
  EXPECT_TRUE(std::any_of(report.notes.begin(), report.notes.end(),
                          [](const std::string& n) { return n.find("pixels left out") != std::string::npos; }));
}

TEST(TransportRegression, WithoutHalvesSurfacesAreCleanedWhetherGuidesKnowThemOrNot) {
  constexpr float kSurface = 0.5f, kHighlight = 40;
  const auto in_highlight = [](int x, int y, double radius) { return std::hypot(x - 14.0, y - 13.0) < radius; };
  const auto truth = [&](int x, int y, size_t) { return in_highlight(x, y, 4) ? kHighlight : kSurface; };
  for (const bool known : {false, true}) {
    Layers frame(kWidth, kHeight);
    put_guides(frame);
    put(frame, layer::beauty, "", [&](int x, int y, size_t c) {
      if (opacity(x, y) > 0) return direct_truth(x, y, c) + indirect_truth(x, y, c);
      return truth(x, y, c) * static_cast<float>(1 + (in_highlight(x, y, 6) ? 0.01 : 0.2) * normal(x, y, 41));
    });
    put(frame, layer::sample_count, "", [](int, int, size_t) { return 16.0f; });
    const auto facing = [](int x, int y, size_t c) { return c == 1 && !(opacity(x, y) > 0) ? -1.0f : 0.0f; };
    if (known) {
      // The highlight's rim is wrong by half a pixel.
      put(frame, {"guide.normal", "XYZ", ""}, "", facing);
      put(frame, {"guide.surface.sun", "RGB", ""}, "", [&](int x, int y, size_t c) {
        return opacity(x, y) > 0 ? 0.0f : in_highlight(x, y, 4.5) ? kHighlight : truth(x, y, c);
      });
    } else {
      put(frame, layer::normal, "", facing);
    }
    const Layers out = clean(frame);
    double before = 0, after = 0;
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
          if (opacity(x, y) > 0) continue;
          const float found = (*out.rgb(layer::beauty)[c])(x, y);
          ASSERT_GT(found, 0.1f) << known << " " << x << " " << y;
          if (in_highlight(x, y, 12) || !is_away(x, y)) continue;
          before += std::pow((*frame.rgb(layer::beauty)[c])(x, y) - kSurface, 2);
          after += std::pow(found - kSurface, 2);
        }
    // A highlight that no guide knows disturbs the fits around it.
    EXPECT_LT(after, (known ? 0.15 : 0.7) * before) << known;
  }
}

TEST(TransportRegression, FramesWithoutGuidesAreCleanedAndSaySo) {
  const Layers frame = make_frame(0.5, 11, indirect_truth, /*guided=*/false);
  ApplyReport report;
  EXPECT_LT(error_of(clean(frame, {}, &report)), 0.6 * error_of(frame));
  EXPECT_TRUE(std::any_of(report.notes.begin(), report.notes.end(), [](const std::string& n) {
    return n.find("--layers direct,indirect,guides") != std::string::npos;
  }));
}

TEST(TransportRegression, ThreadsAndTilesDoNotShow) {
  const Layers frame = make_frame(0.5, 12), one = clean(frame, {1, {}, nullptr});
  expect_the_same_bits(one, clean(frame, {2, {}, nullptr}));
  expect_the_same_bits(one, clean(frame, {4, {}, nullptr}));
  ApplyReport report;
  expect_the_same_bits(one, clean(frame, {2, {}, nullptr}, &report, /*tile=*/32));
  EXPECT_EQ(report.tiles, 1u);
}

TEST(TransportRegression, ColouredGuidesExplainEachColourByItsOwn) {
  // A guide whose colours differ in shape: no single column could explain all three.
  const auto tint = [](int x, int y, size_t c) {
    return opacity(x, y) * (0.5f + 0.4f * std::sin(0.1f * static_cast<float>((static_cast<int>(c) + 1) * x)));
  };
  Layers frame = make_frame(0.5, 13, tint);
  const double without = error_of(clean(frame), tint);
  put(frame, {"guide.multiple.coloured", "RGB", ""}, "", tint);
  EXPECT_LT(error_of(clean(frame), tint), 0.5 * without);
}

TEST(TransportRegression, IsRecommendedWhereThereAreGuidesAndOnlyThere) {
  const Layers with = make_frame(0.5, 14), without = make_frame(0.5, 14, indirect_truth, /*guided=*/false);
  EXPECT_EQ(recommend_filter(with, whole_picture()).filter.entry().name, "transport_regression");
  const Recommendation other = recommend_filter(without, whole_picture());
  EXPECT_NE(other.filter.entry().name, "transport_regression");
  EXPECT_NE(other.reason.find("guides for transport_regression"), std::string::npos) << other.reason;
}

TEST(GuideFeatures, OneWordTakesAllOfThem) {
  const Layers frame = make_frame(0.5, 15);
  const std::vector<Feature> features = FeaturePlan(frame, {"guides"}, {}).build(frame, {}, {});
  std::vector<std::string> names;
  for (const Feature& f : features) names.push_back(f.name);
  EXPECT_EQ(names, (std::vector<std::string>{"guide-opacity", "guide-background"}));
  for (const Feature& f : features)
    for (const Plane& v : f.variance)
      for (int y = 0; y < kHeight; ++y)
        for (const float value : v.pixels(y)) ASSERT_EQ(value, 0.0f);
}

TEST(GuideFeatures, EveryFilterTakesAllFeaturesAtOnce) {
  // 38 channels with the colour: more than a fixed array once held.
  Layers frame = test::noisy_frame(40, 30, 3);
  uint64_t purpose = 0;
  for (const LayerName& l : FeaturePlan::sources()) {
    ++purpose;
    if (l == layer::optical_depth) continue;
    put(frame, l, "", [&](int x, int y, size_t c) { return static_cast<float>(chance(x, y, 3 * purpose + c)); });
  }
  for (const FilterEntry* e : all_filters()) {
    if (!e->features || e->records == FilterEntry::Records::kNeeds) continue;
    FilterSettings settings(*e);
    if (e->find("feature-strength")) settings.set("feature-strength", "1");
    ApplyOptions options;
    options.component = Component::kIndirect;
    options.features = FeaturePlan::names();
    ApplyReport report;
    const Layers out = apply_filter(settings, frame, options, {}, &report);
    EXPECT_EQ(report.not_finite_results, 0u) << e->name;
    EXPECT_EQ(count_not_finite(out.at("G")), 0u) << e->name;
  }
}

TEST(PlaneView, ReadsTheOthersPixelsAndCopiesToAPlaneOfItsOwn) {
  Plane whole(100, 20);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 100; ++x) whole(x, y) = static_cast<float>(100 * y + x);
  const Plane view = Plane::view(whole, 32, 4, 40, 10);
  Plane copy = view;
  copy(0, 0) = -1;
  EXPECT_EQ(whole(32, 4), 432.0f);
  for (int y = 0; y < 10; ++y)
    for (int x = 1; x < 40; ++x) {
      EXPECT_EQ(view(x, y), whole(32 + x, 4 + y));
      EXPECT_EQ(copy(x, y), whole(32 + x, 4 + y));
    }
}

TEST(Stacking, WeightsOnTheSimplexMinimiseTheSquare) {
  // Independent errors of variance 1, 4 and 100: weights as their inverses.
  const std::vector<double> apart = simplex_minimum({1, 0, 0, 0, 4, 0, 0, 0, 100}, {1.0 / 3, 1.0 / 3, 1.0 / 3});
  EXPECT_NEAR(apart[0], 1 / 1.26, 1e-3);
  EXPECT_NEAR(apart[1], 0.25 / 1.26, 1e-3);
  EXPECT_NEAR(apart[2], 0.01 / 1.26, 1e-3);
  // A candidate whose error holds another's whole error and more gets nothing.
  const std::vector<double> worse = simplex_minimum({1, 1.5, 1.5, 4}, {0.5, 0.5});
  EXPECT_NEAR(worse[0], 1, 1e-6);
  EXPECT_NEAR(std::accumulate(worse.begin(), worse.end(), 0.0), 1, 1e-12);
}

}  // namespace
}  // namespace brume
