// Emission along flights and camera rays, and fire as a light, against the definition.

#include <gtest/gtest.h>

#include <cmath>

#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/reference_frame.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::demo;

/// Holds the light of a scene to the definition of the estimator. @param bias  of the picture that must be found
testing::AssertionResult agrees(const Scene& scene, int spp, double bias = 0.08) {
  const test::Agreement a = test::agreement(scene, spp, 1);
  if (a.worst < test::kSigmas && a.detectable < bias) return testing::AssertionSuccess();
  return testing::AssertionFailure() << a.text() << "; allowed " << test::kSigmas << " and " << bias;
}

// Black bodies and ramps, with a lamp in the flames and without, emission far beyond the smoke, in grey and in
// chromatic smoke, against the definition.
TEST(Fire, EmissionIsThatOfTheDefinition) {
  const auto fire = [](const std::function<void(Scene&)>& change) {
    Scene scene = demo("fire", 32);
    scene.surfaces.clear();
    scene.film.height = 32;
    change(scene);
    return scene;
  };
  LightSettings lamp;
  lamp.type = "sphere", lamp.position = {0.2, 0, 0.6}, lamp.radius = 0.2, lamp.radiance = dvec3(3);
  lamp.visible_to_camera = true;
  const std::pair<const char*, Scene> cases[] = {
      {"black body", fire([](Scene& s) { s.lights.clear(); })},
      {"with a lamp inside", fire([&](Scene& s) {
         s.lights.push_back(lamp);
         s.volumes[0].emission = dvec3(2, 1, 0);
       })},
      {"beyond the smoke", fire([](Scene& s) {
         VolumeSettings& v = s.volumes[0];
         v.grid = "flame";
         v.flame_grid = "density";
         v.flame_intensity = 3;
         s.environment.radiance = dvec3(0.5);
       })},
      {"a ramp of many stops", fire([](Scene& s) {
         VolumeSettings& v = s.volumes[0];
         v.temperature_grid = "none";
         v.flame_grid = "flame";
         for (int i = 0; i < 70; ++i) v.flame_ramp.push_back({i / 70.0, i % 3 * 1.0, i / 50.0, i / 100.0});
       })}};
  for (const auto& [name, chosen] : cases) {
    Scene scene = chosen;
    EXPECT_TRUE(agrees(scene, 160, 0.1)) << name;
    const dvec3 sigma_t = scene.volumes[0].sigma_t;
    scene.volumes[0].sigma_t = sigma_t * dvec3(1, 0.6, 0.3);
    EXPECT_TRUE(agrees(scene, 160, 0.1)) << name << ", chromatic";
  }
}

// Fire as a light: of floors and smoke that lie far from it, beside a lamp, in colours, from behind clear glass, of a
// grid and of a shape; against the definition, which finds fire by directions alone.
TEST(Fire, FireLightsWhatIsFarFromIt) {
  const auto scene_of = [](const std::function<void(Scene&)>& change) {
    Scene s = demo("fire", 16);  // its floor, without its ball
    s.film.height = 16;
    s.camera.look_at = {0.3, 0, 0.5};
    s.lights.clear();
    s.surfaces.resize(1);
    VolumeSettings& fire = s.volumes[0];
    fire.object_to_world = test::translation({-0.8, 0, 0.2});
    for (int a = 0; a < 3; ++a) fire.object_to_world[a][a] = 0.5;
    VolumeSettings smoke;
    smoke.shape = "sphere";
    smoke.lo = {0.7, -0.6, 0.3}, smoke.hi = {1.7, 0.4, 1.3};
    smoke.sigma_t = dvec3(1.5);
    smoke.albedo = dvec3(0.8);
    smoke.g = 0.5;
    s.volumes.push_back(smoke);
    change(s);
    return s;
  };
  LightSettings lamp;
  lamp.type = "sphere", lamp.position = {1, -1, 2}, lamp.radius = 0.2, lamp.radiance = dvec3(3);
  const std::pair<const char*, Scene> cases[] = {
      {"flames", scene_of([](Scene&) {})},
      {"beside a lamp", scene_of([&](Scene& s) { s.lights.push_back(lamp); })},
      {"colours", scene_of([](Scene& s) { s.volumes[1].sigma_t = dvec3(2, 1.2, 0.6); })},
      {"a glowing ball", scene_of([](Scene& s) {
         VolumeSettings& ball = s.volumes[0];
         ball = s.volumes[1];
         ball.lo = dvec3(-0.5), ball.hi = dvec3(0.5);
         ball.object_to_world = test::translation({-0.6, 0, 0.6});
         ball.object_to_world[0][0] = 0.3;
         ball.emission = dvec3(20, 10, 3);
       })},
      {"no smoke", scene_of([](Scene& s) { s.volumes.resize(1); })}};
  for (const auto& [name, scene] : cases) {
    const PreparedScene prepared(scene, {});
    ASSERT_NE(prepared.lights().field(0), nullptr) << name;
    EXPECT_TRUE(agrees(scene, 1500, 0.1)) << name;
  }
  // Straight through clear glass light samples alone find it, which makes it direct light; the sum stays.
  Scene behind_glass = cases[0].second;
  SurfaceSettings glass = behind_glass.surfaces[0];
  glass.file = test::source("data/meshes/ball.obj");
  glass.material = "dielectric", glass.albedo = dvec3(1), glass.ior = 1.0001, glass.roughness = 0,
  glass.shadow = "straight";
  glass.object_to_world = test::translation({-0.1, 0, 0.5});
  for (int a = 0; a < 3; ++a) glass.object_to_world[a][a] = 0.4;
  behind_glass.surfaces.push_back(glass);
  const auto mean = [&](const char* sampling) {
    behind_glass.render.light_sampling = sampling;
    return test::mean_radiance(PreparedScene(behind_glass, {}).render(3000, 1).layers, layer::beauty);
  };
  const test::Mean points = mean("auto"), directions = mean("none");
  const double error = std::hypot(points.error.x, directions.error.x);
  EXPECT_NEAR(points.value.x, directions.value.x, 5 * error);
  EXPECT_LT(error, 0.01 * directions.value.x);
}

// A floor under a small flame. Directions seldom find it: they leave 2.5 times the floor's light as noise after 64
// samples; points leave 1 %.
TEST(Fire, SmallFlamesLightFloorsWithLittleNoise) {
  Scene scene = demo("fire", 8);
  scene.film.height = 8;
  scene.lights.clear();
  scene.environment.radiance = dvec3(0);
  scene.surfaces.resize(1);
  VolumeSettings flame;
  flame.shape = "box";
  flame.lo = {0.45, -0.05, 0.95}, flame.hi = {0.55, 0.05, 1.05};
  flame.sigma_t = dvec3(1e-6), flame.albedo = dvec3(0), flame.emission = dvec3(1000);
  scene.volumes = {flame};
  scene.camera.type = "orthographic";
  scene.camera.width = 0.02;
  scene.camera.position = {0, -0.01, 5}, scene.camera.look_at = dvec3(0);
  const Layers frame = PreparedScene(scene, LayerRequest::of({"surface"}, true)).render(64, 1).layers;
  // Each point is at (0.5, 0, 1) on average: radiance albedo / pi * cos / r^2 of an intensity of 1000 / 1000.
  const double expected = scene.surfaces[0].albedo.x / kPi / std::pow(1.25, 1.5);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) EXPECT_NEAR(frame.at("surface.R")(x, y), expected, 0.06 * expected) << x << ' ' << y;
}

// Along a camera ray what flames send through their smoke needs no chance: against a sum over ten thousand steps, and
// all samples of a pixel that one ray passes through are nearly alike. A bias of .2 % would be found.
TEST(Fire, CameraRaysSeeFlamesThroughSmokeWithoutNoise) {
  Scene scene = demo("fire", 8);
  scene.surfaces.clear();
  scene.lights.clear();
  scene.environment.radiance = dvec3(0);
  scene.volumes[0].albedo = dvec3(0);
  scene.volumes[0].sigma_t = dvec3(40);
  scene.camera.type = "orthographic";
  scene.camera.width = 1e-6;
  const SceneMedia media(scene, {});
  for (const double x : {-0.2, 0.0, 0.15}) {
    scene.camera.position = {x, -5, 0.5};
    scene.camera.look_at = {x, 0, 0.5};
    const PreparedScene prepared(scene, LayerRequest::of({"emission"}, true));
    ASSERT_TRUE(prepared.plan().seen_emission);
    const Layers frame = prepared.render(64, 1).layers;
    const Medium& smoke = media.media()[0];
    const EmissionField& flame = media.emissions()[0];
    constexpr int kSteps = 10000;
    double expected = 0, depth = 0;
    const double step = 10.0 / kSteps;
    for (int k = 0; k < kSteps; ++k) {
      const dvec3 at = dvec3(x, -5 + step * (k + 0.5), 0.5) - media.world_shift();
      const double thickness = step * smoke.extinction_per_density() * smoke.density(smoke.to_local(at));
      expected += step * flame.coefficient(at).x * std::exp(-depth - 0.5 * thickness);
      depth += thickness;
    }
    ASSERT_GT(expected, 0);
    double mean = 0, variance = 0;
    for (int y = 0; y < frame.height(); ++y)
      for (int c = 0; c < frame.width(); ++c) {
        mean += frame.at("emission.R")(c, y) / (8.0 * frame.height());
        variance += 64 * frame.at("emission.mean_variance.R")(c, y) / (8.0 * frame.height());
      }
    EXPECT_NEAR(mean, expected, 2e-3 * expected) << x;
    EXPECT_LT(std::sqrt(variance), 0.1 * expected) << x;  // of one sample; a random collision would leave more than 1
  }
}

// So they do through several media, homogeneous ones and chromatic ones among them: without noise the layer is what
// flights find in the mean.
TEST(Fire, CameraRaysSeeFlamesThroughAllMedia) {
  Scene scene = demo("fire", 16);
  scene.surfaces.clear();
  scene.lights.clear();
  VolumeSettings smoke = scene.volumes[0], haze;
  smoke.temperature_grid = "none";
  smoke.sigma_t = dvec3(5);
  smoke.object_to_world = test::translation({0.2, -0.5, 0.1}) * smoke.object_to_world;
  haze.shape = "sphere";
  haze.lo = {-0.4, -1.5, 0.2}, haze.hi = {0.6, 0.5, 1.2};
  haze.sigma_t = dvec3(1);
  scene.volumes.push_back(smoke);
  scene.volumes.push_back(haze);
  for (const dvec3& colour : {dvec3(1), dvec3(1, 0.6, 0.3)}) {
    for (VolumeSettings& v : scene.volumes) v.sigma_t *= colour;
    ASSERT_TRUE(PreparedScene(scene, {}).plan().seen_emission);
    EXPECT_TRUE(agrees(scene, 400)) << colour.y;
  }
}

// Equilibrium furnace: smoke that glows as much as it absorbs from a sky of 1 shows 1 in every pixel. 5 standard errors
// of the mean are below 0.3 %; those of each pixel cover it, and three scatterings that the pixel may lack by chance.
TEST(Fire, InBalanceWithTheSkyIsInvisible) {
  Scene scene = demo("smoke", 32);
  scene.lights.clear();
  scene.environment.radiance = dvec3(1);
  VolumeSettings& v = scene.volumes[0];
  v.albedo = dvec3(0.6);
  v.emission = v.sigma_t * (dvec3(1) - v.albedo);
  const PreparedScene prepared(scene, {});
  ASSERT_TRUE(prepared.plan().one_grid);
  const Layers frame = prepared.render(1024, 1, {}).layers;
  const test::Mean m = test::mean_radiance(frame);
  EXPECT_NEAR(m.value.x, 1, 5 * m.error.x);
  EXPECT_LT(5 * m.error.x, 0.003);
  int far = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x)
      far += std::abs(frame.at("R")(x, y) - 1) > 5 * std::sqrt(frame.at("mean_variance.R")(x, y)) + 3.0 / 1024;
  EXPECT_LE(far, 1);
}

}  // namespace
}  // namespace brume
