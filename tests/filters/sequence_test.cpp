// Filters that look into the frames before and after.

#include <gtest/gtest.h>

#include <cmath>
#include <list>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/inputs/guide_layers.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

using test::sampled_frame;

constexpr int kWidth = 48, kHeight = 40;
constexpr double kDeviation = 0.5;

/// A picture that moves by `speed` pixels per frame.
test::Value scene(int frame, int speed = 0) {
  return [=](int x, int y, size_t c) {
    const float u = static_cast<float>(x - speed * frame), v = static_cast<float>(y);
    return 0.6f + 0.1f * static_cast<float>(c) + 0.3f * std::sin(0.1f * u) * std::cos(0.1f * v);
  };
}

struct Shot {
  std::list<Layers> layers;
  std::list<test::Records> records;
  ApplyOptions options;

  /// Frames -reach .. reach around one, each sampled by itself.
  explicit Shot(int reach, int speed = 0) {
    for (int d = -reach; d <= reach; ++d) {
      Layers& frame = layers.emplace_back(
          sampled_frame(kWidth, kHeight, 8, kDeviation, 40 + static_cast<uint64_t>(d + reach), scene(d, speed)));
      // The flash image shows what the light shows, a feature's records what position they are of.
      test::put(frame, layer::flash, "", [&](int x, int y, size_t c) { return scene(d, speed)(x, y, c); });
      test::put(frame, layer::flash, statistic::mean_variance, [](int, int, size_t) { return 1e-3f; });
      test::Records& r = records.emplace_back(frame);
      if (d == 0) {
        own = &frame;
        options.records = &*r.reader;
      } else
        options.sequence.push_back({d, &frame, &*r.reader});
    }
  }
  const Layers* own = nullptr;
};

FilterSettings settings(const FilterEntry& e) {
  FilterSettings f(e);
  if (e.name == "random_parameter") {
    f.set("largest-neighborhood", "200");
    f.set("variance", "0.2");
  }
  if (e.name == "virtual_flash") f.set("large-radius", "7");
  return f;
}

std::vector<const FilterEntry*> sequence_filters() {
  std::vector<const FilterEntry*> list;
  for (const FilterEntry* e : all_filters())
    if (e->sequences) list.push_back(e);
  return list;
}

double rms(const Layers& clean, const Layers& frame, const test::Value& truth) {
  double sum = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        sum +=
            std::pow((*clean.rgb(layer::beauty)[c])(x, y) - (*frame.rgb(layer::direct)[c])(x, y) - truth(x, y, c), 2);
  return std::sqrt(sum / (3 * kWidth * kHeight));
}

TEST(Sequence, MoreFramesOfTheSamePictureMakeItBetter) {
  ASSERT_EQ(sequence_filters().size(), 7u);
  const Shot shot(2);
  for (const FilterEntry* e : sequence_filters()) {
    ApplyOptions still = shot.options;
    still.sequence.clear();
    const double one = rms(apply_filter(settings(*e), *shot.own, still, {}), *shot.own, scene(0));
    const Layers out = apply_filter(settings(*e), *shot.own, shot.options, {});
    EXPECT_LT(rms(out, *shot.own, scene(0)), 0.9 * one) << e->name;
    EXPECT_EQ(out.text("filterFrames"), "-2, -1, +1, +2");
  }
}

TEST(Sequence, FramesOfAnotherPictureDoNotSpoilIt) {
  // The frames beside it are twice as bright.
  Shot shot(1);
  for (const FilterEntry* e : sequence_filters()) {
    if (e->records == FilterEntry::Records::kNeeds) continue;  // trusts its features, which the test's records share
    std::list<Layers> others;
    ApplyOptions options = shot.options;
    for (SequenceFrame& f : options.sequence) {
      Layers& bright = others.emplace_back(*f.layers);
      for (const LayerName& l : {layer::indirect, layer::flash})
        for (Plane* p : bright.add_rgb(l))
          for (int y = 0; y < kHeight; ++y)
            for (float& v : p->pixels(y)) v += 3.0f;
      f.layers = &bright;
    }
    ApplyOptions still = shot.options;
    still.sequence.clear();
    const double one = rms(apply_filter(settings(*e), *shot.own, still, {}), *shot.own, scene(0));
    EXPECT_LT(rms(apply_filter(settings(*e), *shot.own, options, {}), *shot.own, scene(0)), 1.02 * one) << e->name;
  }
}

TEST(Sequence, MotionIsFollowed) {
  const Shot moving(1, 2);
  for (const FilterEntry* e : sequence_filters()) {
    ApplyOptions still = moving.options;
    still.sequence.clear();
    const double one = rms(apply_filter(settings(*e), *moving.own, still, {}), *moving.own, scene(0));
    const double three = rms(apply_filter(settings(*e), *moving.own, moving.options, {}), *moving.own, scene(0));
    EXPECT_LT(three, 1.02 * one) << e->name;
  }
}

TEST(Sequence, TheOrderInWhichFramesAreGivenIsNothing) {
  const Shot shot(1);
  for (const FilterEntry* e : sequence_filters()) {
    ApplyOptions turned = shot.options;
    std::swap(turned.sequence[0], turned.sequence[1]);
    const Layers a = apply_filter(settings(*e), *shot.own, shot.options, {}),
                 b = apply_filter(settings(*e), *shot.own, turned, {});
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) ASSERT_EQ(a.at("G")(x, y), b.at("G")(x, y)) << e->name;
  }
}

TEST(Sequence, TilesAndCarriedLayersWorkAsForOneFrame) {
  const Shot shot(1);
  for (const FilterEntry* e : sequence_filters()) {
    const FilterSettings f = settings(*e);
    const Layers whole = apply_filter(f, *shot.own, shot.options, {});
    ApplyOptions options = shot.options;
    options.tile = 20;
    const Layers tiled = apply_filter(f, *shot.own, options, {});
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) ASSERT_NEAR(whole.at("G")(x, y), tiled.at("G")(x, y), 3e-4) << e->name;
    if (!e->carries) continue;
    options.component = Component::kAll;
    options.carried = {layer::direct, layer::indirect};
    const Layers out = apply_filter(f, *shot.own, options, {});
    // The beauty of these frames is not the sum of their samples; what is carried is held to what carries it alone.
    options.carried = {layer::direct};
    const Layers direct = apply_filter(f, *shot.own, options, {});
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) ASSERT_EQ(out.at("direct.G")(x, y), direct.at("direct.G")(x, y)) << e->name;
  }
}

TEST(Sequence, FramesWithOtherGuidesAreRefused) {
  Shot shot(1);
  const auto put_guides = [](Layers& frame, bool more) {
    test::put(frame, guide_layer::opacity, "", [](int, int, size_t) { return 0.9f; });
    if (more)
      test::put(frame, guide_layer::density, "", [](int x, int, size_t) { return 0.01f * static_cast<float>(x); });
  };
  bool more = true;
  for (Layers& frame : shot.layers) {
    put_guides(frame, more);
    more = false;
  }
  try {
    apply_filter(parse_filter("transport_regression"), *shot.own, shot.options, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("the frame at -1 of the sequence: its guides are density, opacity"),
              std::string::npos)
        << error.what();
  }
}

TEST(Sequence, SaysWhichFrameIsUnfit) {
  const Shot shot(1);
  const auto message = [&](const std::string& filter, const ApplyOptions& options) -> std::string {
    try {
      apply_filter(parse_filter(filter), *shot.own, options, {});
      return "";
    } catch (const InputError& error) {
      return error.what();
    }
  };
  const auto holds = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos ? ::testing::AssertionSuccess() : ::testing::AssertionFailure() << text;
  };
  EXPECT_TRUE(holds(message("bilateral", shot.options),
                    "these look into the frames before and after: gradient_kernel, least_risk"));
  ApplyOptions options = shot.options;
  const Layers small = sampled_frame(20, 20, 8, 0.1, 1, scene(0));
  options.sequence[1].layers = &small;
  EXPECT_TRUE(holds(message("virtual_flash", options), "the frame at +1 of the sequence: it has 20 x 20 pixels"));
  Layers bare(kWidth, kHeight);
  options.sequence[1].layers = &bare;
  EXPECT_TRUE(holds(message("virtual_flash", options), "the frame at +1 of the sequence: filter virtual_flash needs"));
  options = shot.options;
  options.sequence[0].records = nullptr;
  EXPECT_TRUE(holds(message("random_parameter", options), "the frame at -1 of the sequence: filter random_parameter"));
}

}  // namespace
}  // namespace brume
