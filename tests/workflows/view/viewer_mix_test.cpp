// Light groups mixed while a scene is looked at: what is shown without rendering again is what the lights would make,
// and the mix goes back into the scene.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "base/error.h"
#include "image/light_layers.h"
#include "render/scene/scene_io.h"
#include "tests/support/files.h"
#include "tests/support/viewing.h"
#include "workflows/view/viewed_layers.h"

namespace brume {
namespace {

using test::look;
using test::mean;
using test::value;
using test::Viewing;

/// A plume under a sky, a sun and a lamp.
constexpr const char* kPlume = R"([camera]
position = [0, -6, 1.2]
look_at = [0.3, 0, 1]
fov = 40
[environment]
radiance = [0.16, 0.21, 0.31]  # dusk
group = "sky"
[[volumes]]
file = "{}"
sigma_t = 12
albedo = 0.9
[[lights]]
type = "sun"
direction = [-1, -0.5, 0.6]
irradiance = [3, 2.8, 2.4]
group = "key"
[[lights]]
type = "sphere"
position = [1.6, 0.4, 1.6]
radius = 0.25
radiance = [8, 3, 1]
)";

class Plume {
 public:
  explicit Plume(const std::string& more = "") {
    std::ofstream(path()) << fmt::format(fmt::runtime(kPlume), test::source("data/volumes/smoke.vdb").string()) << more;
  }
  std::filesystem::path path() const { return folder_ / "plume.toml"; }

 private:
  test::TemporaryFolder folder_;
};

const LightMix kMix = {{"key", dvec3(0)}, {"rest", dvec3(2, 1, 0.5)}};

ViewLook mixed(uint64_t id, const LightMix& mix = kMix) {
  ViewLook l = look(id);
  l.mix = mix;
  return l;
}

/// Largest difference of two pictures over the mean of the first.
double difference(const ViewPicture& a, const ViewPicture& b) {
  double most = 0;
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < a.height; ++y)
      for (int x = 0; x < a.width; ++x)
        most = std::max(most, std::abs(static_cast<double>(value(a, c, x, y) - value(b, c, x, y))));
  return most / mean(a);
}

TEST(ViewerMix, IsShownWithoutRenderingAgainAsTheSumOfTheCleanGroups) {
  const Plume plume;
  Viewing v(plume.path());
  ViewLook plain = look(1), asked = mixed(2);
  plain.most_samples = asked.most_samples = 16;
  v.viewer.look(plain);
  ASSERT_TRUE(
      v.audience.wait([](const auto& a) { return !a.told.empty() && a.told.back().stage == ViewStage::kDone; }));
  EXPECT_EQ(v.audience.scenes.back().light_groups, (std::vector<std::string>{"sky", "key", "rest"}));
  asked.layers = {"picture", "noisy", "light.rest"};
  v.viewer.look(asked);  // answers within this call
  const auto frame = v.viewer.frame();
  ASSERT_TRUE(frame);
  for (const std::string layer : {"picture", "noisy", "light.rest"}) {
    const auto shown = v.audience.first([&](const ViewPicture& p) { return p.id == 2 && p.layer == layer; });
    ASSERT_TRUE(shown) << layer;
    EXPECT_FALSE(shown->predicted || shown->misses_mix);
    double sum_of_all = 0;
    for (int c = 0; c < 3; ++c)
      for (int y = 0; y < shown->height; ++y)
        for (int x = 0; x < shown->width; ++x) {
          double sum = 0;
          for (const std::string group : {"sky", "key", "rest"}) {
            if (layer == "light.rest" && group != "rest") continue;
            const auto factor = kMix.find(group);
            const std::string from = layer == "noisy" ? light_layer(group) : clean_light_layer(group);
            sum += (factor == kMix.end() ? 1 : factor->second[c]) *
                   static_cast<double>(frame->at(from + "." + "RGB"[c])(x, y));
          }
          EXPECT_NEAR(value(*shown, c, x, y), sum, 1e-3 * sum + 1e-6) << layer << " " << c << " " << x << " " << y;
          sum_of_all += sum;
        }
    EXPECT_GT(sum_of_all, 1);
  }
  for (const auto& [id, stage] : v.audience.stages)
    EXPECT_TRUE(id != 2 || stage == ViewStage::kDone) << "nothing is computed for it";
}

// The light of a scene is linear in its lights: the scene with other lights is the answer that the mix has to give.
TEST(ViewerMix, IsThePictureOfTheSceneWithOtherLights) {
  const Plume plume;
  Viewing v(plume.path());
  const ViewLook asked = mixed(1, {{"key", dvec3(0.25)}, {"rest", dvec3(2, 1, 0.5)}});
  const auto predicted = [](uint64_t id) {
    return [id](const ViewPicture& p) { return p.id == id && p.predicted && p.full; };
  };
  const auto clean = [](uint64_t id) { return [id](const ViewPicture& p) { return p.id == id && p.samples >= 64; }; };
  v.viewer.look(asked);
  const auto guessed = v.audience.first(predicted(1)), rendered = v.audience.first(clean(1));
  ASSERT_TRUE(guessed && rendered);
  const std::vector<std::string> lights = v.viewer.mix_assignments(asked);
  EXPECT_EQ(lights,
            (std::vector<std::string>{"lights.0.irradiance=[0.75, 0.7, 0.6]", "lights.1.radiance=[16, 3, 0.5]"}));
  v.viewer.look(look(2, lights));
  const auto other_guessed = v.audience.first(predicted(2)), other_rendered = v.audience.first(clean(2));
  ASSERT_TRUE(other_guessed && other_rendered);
  EXPECT_LT(difference(*guessed, *other_guessed), 0.01);
  EXPECT_NEAR(mean(*rendered) / mean(*other_rendered), 1, 0.02);
  v.viewer.look(look(3));
  const auto as_it_was = v.audience.first(predicted(3));
  ASSERT_TRUE(as_it_was);
  EXPECT_GT(difference(*as_it_was, *guessed), 0.3) << "the test could fail";
}

TEST(ViewerMix, GoesIntoTheSceneTheCommandAndTheFrame) {
  const Plume plume;
  Viewing v(plume.path());
  v.viewer.look(mixed(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.samples >= 16; }));
  ViewLook asked = mixed(1);
  const std::string text = v.viewer.scene_text(asked);
  EXPECT_NE(text.find("# dusk"), std::string::npos) << text;
  const Scene scene = parse_scene_alone(text, plume.path());
  EXPECT_EQ(scene.lights[0].irradiance, dvec3(0));
  EXPECT_EQ(scene.lights[1].radiance, dvec3(16, 3, 0.5));
  EXPECT_NE(v.viewer.command(asked).find("lights.1.radiance="), std::string::npos);
  const auto frame = v.viewer.frame(asked);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->text("lightMix"), "key = 0, 0, 0; rest = 2, 1, 0.5");
  EXPECT_FALSE(frame->find("clean_direct.R")) << "of light that was not mixed";
  // Changes of the page come first, as what is mixed is what they make.
  asked.assignments = {"lights.1.radiance=[1, 1, 1]"};
  EXPECT_EQ(parse_scene_alone(v.viewer.scene_text(asked), plume.path()).lights[1].radiance, dvec3(2, 1, 0.5));
}

TEST(ViewerMix, GroupsThatAreNotThereAreTold) {
  const Plume plume;
  Viewing v(plume.path());
  v.viewer.look(mixed(1, {{"kye", dvec3(0)}}));
  ASSERT_TRUE(v.audience.wait([](const auto& a) { return !a.problems.empty(); }));
  EXPECT_NE(v.audience.problems[0].second.find("'kye'"), std::string::npos);
  EXPECT_NE(v.audience.problems[0].second.find("sky, key, rest"), std::string::npos) << v.audience.problems[0].second;
  v.viewer.look(look(2));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 2 && p.samples >= 8; }));
  v.viewer.look(mixed(3, {{"kye", dvec3(0)}}));
  ASSERT_TRUE(v.audience.wait([](const auto& a) { return a.problems.size() == 2; }));
  EXPECT_EQ(v.audience.problems[1].first, 3u);
  v.viewer.look(mixed(4));
  EXPECT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 4; }));
  EXPECT_THROW(v.viewer.scene_text(mixed(5, {{"kye", dvec3(0)}})), InputError);
}

TEST(ViewerMix, ScenesWithoutGroupsHaveNothingOfIt) {
  Viewing v(test::source("data/scenes/cloud.toml"));
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.samples >= 8; }));
  EXPECT_TRUE(v.audience.scenes.back().light_groups.empty());
  const auto& listed = v.audience.scenes.back().layers;
  EXPECT_TRUE(std::none_of(listed.begin(), listed.end(),
                           [](const auto& layer) { return layer.name.starts_with(kLightPrefix); }));
  EXPECT_TRUE(viewed_light_groups(*v.viewer.frame()).empty());
  v.viewer.look(mixed(2));
  ASSERT_TRUE(v.audience.wait([](const auto& a) { return !a.problems.empty(); }));
  EXPECT_NE(v.audience.problems[0].second.find("light_groups = true"), std::string::npos);
}

// Media of unlike tints: guides know no groups, so a prediction is as it was and says so, and samples are mixed.
TEST(ViewerMix, WhatIsNotKnownByGroupSaysSo) {
  const Plume plume(fmt::format("[[volumes]]\nfile = \"{}\"\nsigma_t = 6\nalbedo = [0.9, 0.3, 0.2]\n",
                                test::source("data/volumes/cloud.vdb").string()));
  Viewing v(plume.path());
  ViewLook asked = mixed(1);
  asked.layers = {"picture", "clean_direct"};
  v.viewer.look(asked);
  const auto is = [](const char* layer, bool predicted) {
    return [=](const ViewPicture& p) { return p.layer == layer && p.predicted == predicted && p.full; };
  };
  const auto guessed = v.audience.first(is("picture", true)), rendered = v.audience.first(is("picture", false)),
             direct = v.audience.first(is("clean_direct", false));
  ASSERT_TRUE(guessed && rendered && direct);
  EXPECT_TRUE(guessed->misses_mix);
  EXPECT_FALSE(rendered->misses_mix);
  EXPECT_TRUE(direct->misses_mix);
}

Layers two_groups() {
  Layers frame(3, 1);
  const auto set = [&](const std::string& name, std::vector<float> values) {
    for (const char c : {'R', 'G', 'B'}) {
      Plane plane(3, 1);
      for (int x = 0; x < 3; ++x) plane(x, 0) = values[static_cast<size_t>(x)];
      frame.set(name.empty() ? std::string(1, c) : name + "." + c, std::move(plane));
    }
  };
  // The middle has light that no group knows of, the right one nothing else.
  set("guide.predicted_direct", {4, 6, 1});
  set("guide.predicted_indirect", {0, 0, 1});
  for (const std::string group : {"a", "b"}) {
    set(predicted_light_layer(group, "direct"), {group == "a" ? 3.0f : 1.0f, group == "a" ? 1.0f : 2.0f, 0});
    set(predicted_light_layer(group, "indirect"), {0, 0, 0});
  }
  return frame;
}

TEST(ViewedLayer, WhatNoGroupHoldsIsScaledAsTheRestOfThePixelIs) {
  const Layers frame = two_groups();
  const ViewedLayer plain(frame, kViewedPicture, true, {});
  const ViewedLayer mixed(frame, kViewedPicture, true, {{"a", dvec3(2, 0, 1)}});
  EXPECT_FALSE(mixed.misses_mix());
  const Plane before = plain.plane(frame, 0), red = mixed.plane(frame, 0), green = mixed.plane(frame, 1),
              blue = mixed.plane(frame, 2);
  EXPECT_EQ(before(1, 0), 6);
  EXPECT_FLOAT_EQ(red(0, 0), 7);
  EXPECT_FLOAT_EQ(red(1, 0), 6 * 4.0f / 3);
  EXPECT_FLOAT_EQ(red(2, 0), 2 * 11.0f / 7) << "the mean of the others";
  EXPECT_FLOAT_EQ(green(0, 0), 1);
  for (int x = 0; x < 3; ++x) EXPECT_EQ(blue(x, 0), before(x, 0));
  const Plane none = ViewedLayer(frame, kViewedPicture, true, {{"a", dvec3(0)}, {"b", dvec3(0)}}).plane(frame, 0);
  for (int x = 0; x < 3; ++x) EXPECT_EQ(none(x, 0), 0);
}

TEST(ViewedLayer, AGroupAloneHasItsOwnFactor) {
  const Layers frame = two_groups();
  const ViewedLayer alone(frame, light_layer("a"), true, {{"a", dvec3(0.5)}, {"b", dvec3(7)}});
  EXPECT_FLOAT_EQ(alone.plane(frame, 0)(0, 0), 1.5);
  EXPECT_EQ(alone.sources().size(), 6u);
  EXPECT_TRUE(ViewedLayer(frame, light_layer("c"), true, {}).empty());
  EXPECT_EQ(viewed_light_groups(frame), (std::vector<std::string>{"a", "b"}));
}

}  // namespace
}  // namespace brume
