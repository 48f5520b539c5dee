// Alpha without noise: no light beyond its edges, none lost within, whichever filter runs; and alpha that is not.

#include "filters/inputs/alpha_weight.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "filters/api/registry.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr int kSize = 96;

/// Share of a pixel inside of a disc.
float coverage(int x, int y) {
  int inside = 0;
  for (int i = 0; i < 64; ++i) {
    const double u = x + (i % 8 + 0.5) / 8 - kSize / 2.0, v = y + (i / 8 + 0.5) / 8 - kSize / 2.0;
    inside += u * u + v * v < 30.0 * 30.0;
  }
  return static_cast<float>(inside) / 64;
}

/// A disc of noise around 0.6, premultiplied, on nothing.
Layers disc() {
  Layers frame = test::sampled_frame(
      kSize, kSize, 8, 1, [](int x, int y, size_t) { return 0.6f * coverage(x, y); },
      [](int x, int y, size_t, Rng& rng) { return coverage(x, y) * (0.2 + 0.8 * rng.uniform()); });
  std::vector<std::string_view> statistics = {"", statistic::mean_variance, statistic::half_a, statistic::half_b};
  statistics.insert(statistics.end(), statistic::buckets.begin(), statistic::buckets.end());
  for (const std::string_view which : statistics) {
    test::put(frame, layer::direct, which, [](int, int, size_t) { return 0.0f; });
    for (size_t c = 0; c < 3; ++c)
      frame.set(layer::beauty.channel_of(which, c), frame.at(layer::indirect.channel_of(which, c)));
  }
  test::put(frame, layer::alpha, "", [](int x, int y, size_t) { return coverage(x, y); });
  test::put(frame, layer::coverage, "", [](int x, int y, size_t) { return coverage(x, y) > 0 ? 1.0f : 0.0f; });
  return frame;
}

/// Light outside, and the mean of light over alpha in the outermost pixels, over that of all within.
std::pair<double, double> outside_and_rim(const Layers& frame) {
  double outside = 0, rim = 0, rim_alpha = 0, inner = 0, inner_alpha = 0;
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      const double light = frame.at("G")(x, y), a = coverage(x, y);
      const double r = std::hypot(x + 0.5 - kSize / 2.0, y + 0.5 - kSize / 2.0);
      if (a == 0)
        outside = std::max(outside, std::abs(light));
      else if (r > 27)
        rim += light, rim_alpha += a;
      else if (r < 20)
        inner += light, inner_alpha += a;
    }
  return {outside, rim / rim_alpha / (inner / inner_alpha)};
}

TEST(AlphaWeight, NoFilterLeavesLightWhereAlphaIs0NorTakesAnyFromTheRim) {
  const Layers frame = disc();
  Layers without = frame;
  without.remove("A");
  double spilled = 0;
  for (const FilterEntry* e : all_filters()) {
    if (e->records == FilterEntry::Records::kNeeds || e->learned) continue;
    FilterSettings f(*e);
    if (f.entry().find("iterations")) f.set("iterations", "12");
    const auto [outside, rim] = outside_and_rim(apply_filter(f, frame, {}, {}));
    EXPECT_EQ(outside, 0.0) << e->name;
    EXPECT_NEAR(rim, 1.0, 0.03) << e->name;
    spilled = std::max(spilled, outside_and_rim(apply_filter(f, without, {}, {})).first);
  }
  EXPECT_GT(spilled, 0.1) << "so that the test can fail";
}

TEST(AlphaWeight, CarriedLayersAddUp) {
  Layers frame = disc();
  ApplyOptions options;
  options.component = Component::kAll;
  options.carried = {layer::direct, layer::indirect};
  for (const char* which : {"bilateral:average=linear", "nl_means", "gaussian"}) {
    const Layers out = apply_filter(parse_filter(which), frame, options, {});
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x)
        ASSERT_NEAR(out.at("R")(x, y), out.at("direct.R")(x, y) + out.at("indirect.R")(x, y), 1e-5) << which;
  }
}

TEST(AlphaWeight, TilesGiveTheSamePicture) {
  const Layers frame = disc();
  ApplyOptions tiles;
  tiles.tile = 32;
  const Layers whole = apply_filter(parse_filter("nl_means"), frame, {}, {}),
               tiled = apply_filter(parse_filter("nl_means"), frame, tiles, {});
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) ASSERT_NEAR(whole.at("R")(x, y), tiled.at("R")(x, y), 3e-4);
}

/// Three alike planes.
struct Grey {
  Plane plane;
  RgbPlanes rgb() const { return {&plane, &plane, &plane}; }
};

Plane plane_of(const std::function<double(int, int)>& value) {
  Plane plane(kSize, kSize);
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) plane(x, y) = static_cast<float>(value(x, y));
  return plane;
}

TEST(AlphaWeight, PathsThatMissedThinSmokeAreNoEdge) {
  const auto truth = [](int x, int y) {
    return 0.9 * std::exp(-(std::pow(x - kSize / 2.0, 2) + std::pow(y - kSize / 2.0, 2)) / 450);
  };
  for (const int samples : {1, 4, 16, 64}) {
    Rng rng(7);
    const Plane alpha = plane_of([&](int x, int y) {
      int hits = 0;
      for (int i = 0; i < samples; ++i) hits += rng.uniform() < truth(x, y);
      return static_cast<double>(hits) / samples;
    });
    const AlphaWeight w = alpha_weight(alpha, Grey{alpha}.rgb(), nullptr, {});
    double lost = 0, light = 0;
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x) {
        light += truth(x, y);
        if (!w.weight.empty()) lost += (1 - static_cast<double>(w.weight(x, y))) * truth(x, y);
      }
    EXPECT_LT(lost / light, 1e-3) << samples;
  }
}

TEST(AlphaWeight, NoiseWithinASharpEdgeIsNotCopiedToTheLight) {
  Rng rng(3);
  const auto inside = [](int x, int y) { return x > 20 && x < 70 && y > 30 && y < 60; };
  const Plane alpha = plane_of([&](int x, int y) { return inside(x, y) ? 0.5 + 0.1 * rng.uniform() : 0.0; });
  const AlphaWeight w = alpha_weight(alpha, Grey{alpha}.rgb(), nullptr, {});
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) ASSERT_EQ(w.weight(x, y), inside(x, y) ? 1.0f : 0.0f);
}

TEST(AlphaWeight, LightWithoutAlphaIsInside) {
  const Grey light{plane_of([](int x, int y) {
    const bool fire = std::hypot(x - 80, y - 14) < 8;
    return 0.6 * static_cast<double>(coverage(x, y)) + (fire ? 1 : 0);
  })};
  const Plane alpha = plane_of([](int x, int y) { return static_cast<double>(coverage(x, y)); });
  const AlphaWeight w = alpha_weight(alpha, light.rgb(), nullptr, {});
  EXPECT_EQ(w.weight(80, 14), 1.0f);
  EXPECT_EQ(w.weight(2, 2), 0.0f);
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      ASSERT_EQ(w.weight(x, y) > 0, light.plane(x, y) != 0);
      ASSERT_EQ(w.weight(x, y) == 1, coverage(x, y) == 1 || light.plane(x, y) >= 1) << x << "," << y;
    }
  EXPECT_EQ(w.weight(kSize / 2, kSize / 2 - 30), coverage(kSize / 2, kSize / 2 - 30)) << "edges go on by alpha";
}

TEST(AlphaWeight, AFilmOfLightEverywhereIsLeftAlone) {
  const Grey sky{plane_of([](int, int) { return 0.3; })};
  const Plane alpha = plane_of([](int x, int y) { return static_cast<double>(coverage(x, y)); });
  EXPECT_TRUE(alpha_weight(alpha, sky.rgb(), nullptr, {}).weight.empty());
  EXPECT_TRUE(alpha_weight(plane_of([](int x, int) { return x < 9 ? 0.0 : 255.0; }), Grey{alpha}.rgb(), nullptr, {})
                  .weight.empty())
      << "no alpha";
}

TEST(AlphaWeight, ColoursThatAlphaDoesNotMultiplyKeepTheirEdges) {
  Rng rng(5);
  const Grey straight{plane_of([&](int x, int y) { return coverage(x, y) > 0 ? 0.4 + 0.4 * rng.uniform() : 0.0; })};
  const Plane alpha = plane_of([](int x, int y) { return static_cast<double>(coverage(x, y)); });
  const AlphaWeight w = alpha_weight(alpha, straight.rgb(), nullptr, {});
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) ASSERT_EQ(w.weight(x, y), coverage(x, y) > 0 ? 1.0f : 0.0f);
}

TEST(AlphaWeight, WhatIsFilledGoesOnAsItIs) {
  const Plane weight = plane_of([](int x, int y) { return static_cast<double>(coverage(x, y)); });
  const Plane premultiplied = plane_of([](int x, int y) { return 0.7 * static_cast<double>(coverage(x, y)); });
  const Plane filled = EdgeFill(weight, {}).filled(premultiplied, {});
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) ASSERT_NEAR(filled(x, y), 0.7f, 2e-6f);
}

}  // namespace
}  // namespace brume
