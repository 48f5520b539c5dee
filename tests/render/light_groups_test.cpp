// Light groups: each is what its lights alone would make, all of them together are the picture.

#include "render/scene/light_groups.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "image/light_layers.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/random_scene.h"
#include "tests/support/reference_frame.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

/// The same scene, dark but for one group. Lamps stay, as they hide what lies behind.
Scene only(Scene scene, size_t group) {
  const LightGroups groups = light_groups_of(scene);
  if (groups.environment != group) {
    scene.environment.radiance = dvec3(0);
    scene.environment.sky = "none";
  }
  for (size_t i = 0; i < scene.lights.size(); ++i)
    if (LightSettings& l = scene.lights[i]; groups.lights[i] != group)
      l.irradiance = l.radiance = l.intensity = dvec3(0);
  for (size_t i = 0; i < scene.surfaces.size(); ++i)
    if (groups.surfaces[i] != group) scene.surfaces[i].radiance = dvec3(0);
  for (size_t i = 0; i < scene.volumes.size(); ++i)
    if (VolumeSettings& v = scene.volumes[i]; groups.volumes[i] != group) {
      v.emission = dvec3(0);
      v.temperature_grid = v.flame_grid = "none";
    }
  return scene;
}

void expect_sum(const Layers& frame, const std::vector<std::string>& groups, const std::string& part,
                const LayerName& whole) {
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        double sum = 0;
        for (const std::string& group : groups)
          sum += static_cast<double>(frame.at(light_layer(group) + part + "." + whole.channels[c])(x, y));
        const double expected = static_cast<double>((*frame.rgb(whole)[c])(x, y));
        ASSERT_NEAR(sum, expected, 3e-6 * std::abs(expected) + 1e-9) << whole.label() << " " << x << " " << y;
      }
}

void expect_alike(const test::Mean& a, const test::Mean& b) {
  for (int c = 0; c < 3; ++c)
    EXPECT_LE(std::abs(a.value[c] - b.value[c]), test::kSigmas * std::hypot(a.error[c], b.error[c]) + 1e-9)
        << a.value[c] << " and " << b.value[c];
}

/// Each group's mean is that of the same scene with its lights alone, with light samples of its own as well, and the
/// picture that of the scene without groups.
void expect_their_lights_alone(Scene scene) {
  constexpr int kSamples = 16;
  const LayerRequest layers = LayerRequest::of({"direct", "indirect", "light_parts", "light_aimed"}, true);
  const Layers without = PreparedScene(scene, layers).render(kSamples, 1).layers;
  scene.render.light_groups = true;
  const Layers frame = PreparedScene(scene, layers).render(kSamples, 1).layers;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        ASSERT_EQ((*frame.rgb(layer::beauty)[c])(x, y), (*without.rgb(layer::beauty)[c])(x, y)) << "the picture's bits";
  const std::vector<std::string> names = light_groups_of(scene).names;
  expect_sum(frame, names, "", layer::beauty);
  expect_sum(frame, names, ".direct", layer::direct);
  expect_sum(frame, names, ".indirect", layer::indirect);
  for (size_t g = 0; g < names.size(); ++g) {
    SCOPED_TRACE(names[g]);
    const std::string layer = light_layer(names[g]);
    const test::Mean together = test::mean_radiance(frame, {layer, "RGB", ""});
    const test::Mean alone = test::mean_radiance(PreparedScene(only(scene, g), layers).render(kSamples, 2).layers);
    expect_alike(together, alone);
    expect_alike(test::mean_radiance(frame, {aimed_light_layer(names[g]), "RGB", ""}), alone);
  }
}

class LightGroupsOf : public ::testing::TestWithParam<uint64_t> {};

// Grids, homogeneous, chromatic and moving media, surfaces, and lights of all kinds.
TEST_P(LightGroupsOf, RandomScenesAddUpAndAreTheirLightsAlone) {
  const test::TemporaryFolder folder;
  const test::RandomScene random = test::random_scene(GetParam(), folder.path(), 4);
  SCOPED_TRACE(random.text());
  expect_their_lights_alone(random.scene);
}

TEST(LightGroups, OfFireAddUpAndAreTheirLightsAlone) {
  Scene scene = read_scene(test::source("data/scenes/fire.toml"),
                           std::vector<std::string>{"film.width=24", "film.height=18", "environment.radiance=0.1"});
  expect_their_lights_alone(std::move(scene));
}

// Where vertices aim at the smoke around lamps, the groups' own samples leave them their share.
TEST(LightGroups, OfLampsInSmokeAddUpAndAreTheirLightsAlone) {
  const std::string text = "[camera]\nposition = [0, -4, 1.5]\nlook_at = [0, 0, 1.2]\n" +
                           std::string("[film]\nwidth = 24\nheight = 18\n[environment]\nradiance = 0.1\n") +
                           "[[volumes]]\nfile = \"" + test::source("data/volumes/cloud.vdb").string() +
                           "\"\nsigma_t = 4\nalbedo = 0.9\n[[surfaces]]\nfile = \"" +
                           test::source("data/meshes/floor.obj").string() + R"("
[[lights]]
type = "point"
position = [0.2, 0.1, 1.2]
intensity = 1
[[lights]]
type = "spot"
position = [-0.5, 0, 1.3]
direction = [0.3, 0.1, -1]
cone_angle = 70
intensity = 1
)";
  const Scene scene = parse_scene(text, "scene.toml");
  ASSERT_EQ(PreparedScene(scene, {}).plan().lit_balls.size(), 2u);
  expect_their_lights_alone(scene);
  // Both layers share their paths, so that they differ by less than their noise; counted twice, the smoke around the
  // point would bring 15 % more.
  Scene grouped = scene;
  grouped.render.light_groups = true;
  const Layers frame = PreparedScene(grouped, LayerRequest::of({"light_aimed"}, true)).render(600, 3).layers;
  const double own = test::mean_radiance(frame, {light_layer("point"), "RGB", ""}).value[0];
  EXPECT_NEAR(test::mean_radiance(frame, {aimed_light_layer("point"), "RGB", ""}).value[0], own, 0.03 * own);
}

/// With samples of their own, groups have the means that they have without, closely: both share their paths.
void expect_means_with_own_samples(Scene scene, int samples) {
  scene.render.light_groups = true;
  const Layers frame = PreparedScene(scene, LayerRequest::of({"light_aimed"}, true)).render(samples, 3).layers;
  for (const std::string& group : light_groups_of(scene).names) {
    SCOPED_TRACE(group);
    const dvec3 own = test::mean_radiance(frame, {light_layer(group), "RGB", ""}).value,
                aimed = test::mean_radiance(frame, {aimed_light_layer(group), "RGB", ""}).value;
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(aimed[c], own[c], 0.02 * own[c]);
  }
}

// One grid alone keeps its rays and light samples in lanes; directions find the wide sun and the sky as well.
TEST(LightGroups, OfOneGridKeepTheirMeansWithSamplesOfTheirOwn) {
  const std::string text =
      "[camera]\nposition = [0, -4, 1.5]\nlook_at = [0, 0, 1.2]\n"
      "[film]\nwidth = 12\nheight = 9\n[environment]\nsky = \"preetham\"\nturbidity = 3\n"
      "sun_direction = [0.3, -0.5, 0.6]\nsky_sun = false\n[[volumes]]\nfile = \"" +
      test::source("data/volumes/cloud.vdb").string() + R"("
sigma_t = 4
albedo = 0.9
[[lights]]
type = "sun"
direction = [1, -1, 1]
irradiance = 20
angular_diameter = 100
[[lights]]
type = "sun"
direction = [-1, 0, 0.5]
irradiance = 8
)";
  expect_means_with_own_samples(parse_scene(text, "scene.toml"), 512);
}

// A surface's scattering finds a large lamp by its direction; glass lets straight shadows through.
TEST(LightGroups, OnSurfacesKeepTheirMeansWithSamplesOfTheirOwn) {
  const std::string floor = test::source("data/meshes/floor.obj").string();
  const std::string text =
      "[camera]\nposition = [0, -5, 2]\nlook_at = [0, 0, 0]\n"
      "[film]\nwidth = 12\nheight = 9\n[environment]\nradiance = 0.1\n[[volumes]]\n"
      "shape = \"sphere\"\nsigma_t = 1\n[[surfaces]]\nfile = \"" +
      floor + R"("
[[lights]]
type = "sphere"
position = [1.5, -1.5, 1.5]
radius = 0.8
radiance = 2
[[lights]]
type = "sphere"
position = [-1.5, -1.5, 1]
radius = 0.4
radiance = 9
[[lights]]
type = "point"
position = [0, 1, 2]
intensity = 2
)";
  expect_means_with_own_samples(parse_scene(text, "scene.toml"), 512);
}

INSTANTIATE_TEST_SUITE_P(Seeds, LightGroupsOf, ::testing::Values(11, 69, 195));

constexpr const char* kScene = R"(
[camera]
position = [0, -5, 0]
look_at = [0, 0, 0]
[film]
width = 16
height = 12
[environment]
radiance = 0.2
[[volumes]]
shape = "sphere"
sigma_t = 3
[[lights]]
type = "sun"
direction = [1, -1, 1]
irradiance = 1
group = "key"
[[lights]]
type = "point"
position = [-1, -1, 1]
intensity = 1
)";

TEST(LightGroups, WhatHasNoNameIsTheRest) {
  EXPECT_EQ(light_groups_of(parse_scene(kScene, "scene.toml")).names, (std::vector<std::string>{"key", "rest"}));
  const LightGroups each =
      light_groups_of(parse_scene(kScene, "s.toml", std::vector<std::string>{"render.light_groups=true"}));
  EXPECT_EQ(each.names, (std::vector<std::string>{"key", "sky", "point"}));
  EXPECT_EQ(each.environment, 1u);
  EXPECT_EQ(each.lights, (std::vector<size_t>{0, 2}));
  EXPECT_TRUE(
      light_groups_of(parse_scene(kScene, "s.toml", std::vector<std::string>{"lights.0.enabled=false"})).names.empty());
}

TEST(LightGroups, BadNamesAreRefused) {
  for (const char* name : {"", "rest", "a.b", "a b", "half_a", "bucket_3"}) {
    const std::string text = test::error_of([&] {
      parse_scene(kScene, "scene.toml", std::vector<std::string>{std::string("lights.1.group=\"") + name + "\""});
    });
    EXPECT_NE(text.find("'group'"), std::string::npos) << name << ": " << text;
  }
  EXPECT_NE(test::error_of([] {
              parse_scene(kScene, "scene.toml", std::vector<std::string>{"volumes.0.group=\"fire\""});
            }).find("nothing shines"),
            std::string::npos);
}

double mean_variance(const Layers& frame, const std::string& layer) {
  double sum = 0;
  const Plane& plane = frame.at((layer.empty() ? "" : layer + ".") + "mean_variance.G");
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x) sum += static_cast<double>(plane(x, y));
  return sum / (static_cast<double>(plane.width()) * plane.height());
}

// A dim lamp beside bright ones has the noise that it has alone, on surfaces as well as in media; in the picture it
// gets a few of the shadow rays alone.
TEST(LightGroups, WithSamplesOfTheirOwnHaveTheNoiseOfTheirLightsAlone) {
  const std::string text = std::string(kScene) +
                           "[[lights]]\ntype = \"sphere\"\nposition = [1.5, -1.5, 1]\nradius = 0.2\nradiance = 2\n"
                           "[[surfaces]]\nfile = \"" +
                           test::source("data/meshes/floor.obj").string() + "\"\n";
  const Scene scene = parse_scene(text, "scene.toml",
                                  std::vector<std::string>{"render.light_groups=true", "camera.position=[0, -5, 2]"});
  const Layers frame = PreparedScene(scene, LayerRequest::of({"light_aimed"}, true)).render(64, 1).layers;
  const std::vector<std::string> names = light_groups_of(scene).names;
  const auto number = static_cast<size_t>(std::find(names.begin(), names.end(), "sphere") - names.begin());
  ASSERT_LT(number, names.size());
  const Layers alone = PreparedScene(only(scene, number), LayerRequest::of({}, true)).render(64, 2).layers;
  EXPECT_LT(mean_variance(frame, aimed_light_layer("sphere")), 1.2 * mean_variance(alone, ""));
  EXPECT_GT(mean_variance(frame, light_layer("sphere")), 3 * mean_variance(alone, ""));
}

TEST(LightGroups, OneSampledLightNeedsNoOtherSamples) {
  const Scene scene =
      parse_scene(kScene, "scene.toml", std::vector<std::string>{"render.light_groups=true", "lights.1.enabled=false"});
  const Layers frame = PreparedScene(scene, LayerRequest::of({"light_aimed"}, false)).render(4, 1).layers;
  for (const char* group : {"key", "sky"})
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        ASSERT_EQ(frame.at(aimed_light_layer(group) + ".R")(x, y), frame.at(light_layer(group) + ".R")(x, y));
}

// Limited light is taken from all groups alike, and parts merge.
TEST(LightGroups, AddUpWhereIndirectLightIsLimited) {
  const Scene scene = parse_scene(kScene, "scene.toml", std::vector<std::string>{"render.indirect_limit=0.05"});
  const Layers frame = PreparedScene(scene, LayerRequest::of({"light_parts"}, true)).render(8, 1).layers;
  expect_sum(frame, {"key", "rest"}, "", layer::beauty);
}

}  // namespace
}  // namespace brume
