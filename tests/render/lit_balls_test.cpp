// Smoke around lamps, which vertices aim at: against the definition of the estimator, which does not know of it.

#include "render/transport/lit_balls.h"

#include <gtest/gtest.h>

#include "tests/support/files.h"
#include "tests/support/reference_frame.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

/// A point of light and a spot inside a cloud, over a floor.
Scene lamps_in_cloud() {
  Scene s = test::scene_of(test::source("data/volumes/cloud.vdb"), 2.5, 0.8, 0.3);
  s.film.width = 32, s.film.height = 24;
  s.environment.radiance = dvec3(0.1);
  LightSettings lamp;
  lamp.type = "point", lamp.position = dvec3(0.2, 0.1, 1.2), lamp.intensity = dvec3(1, 0.7, 0.5);
  s.lights.push_back(lamp);
  lamp.type = "spot", lamp.position = dvec3(-0.5, 0, 1.3), lamp.direction = dvec3(0.3, 0.1, -1);
  lamp.cone_angle = 70;
  s.lights.push_back(lamp);
  return s;
}

void add_floor(Scene& s) {
  SurfaceSettings& floor = s.surfaces.emplace_back();
  floor.file = test::source("data/meshes/floor.obj");
  floor.albedo = dvec3(0.6, 0.5, 0.4);
  floor.object_to_world = test::translation(dvec3(0, 0, 0.2));
}

void expect_agreement(const Scene& s, int spp, double bias) {
  ASSERT_FALSE(PreparedScene(s, {}).plan().lit_balls.empty());
  const test::Agreement a = test::agreement(s, spp, 1);
  std::printf("%s\n", a.text().c_str());
  EXPECT_LT(a.worst, test::kSigmas) << a.text();
  EXPECT_LT(a.detectable, bias) << a.text();
}

// Grey over a floor, chromatic beside a second medium. The definition's own noise decides what is found: it
// has no bound at lamps.
TEST(LitBalls, AgreeWithTheDefinition) {
  Scene s = lamps_in_cloud();
  add_floor(s);
  expect_agreement(s, 320, 0.1);
  VolumeSettings fog;
  fog.shape = "sphere", fog.object_to_world = test::translation(dvec3(0.3, 0, 1.2));
  fog.sigma_t = dvec3(0.4, 0.3, 0.2), fog.albedo = dvec3(0.7), fog.g = -0.2;
  s.volumes.push_back(fog);
  expect_agreement(s, 1000, 0.1);
}

// Where paths are cut at one, two and three events, flights and points are cut alike.
TEST(LitBalls, EndWherePathsAreCut) {
  Scene s = lamps_in_cloud();
  add_floor(s);
  for (const int events : {1, 2, 3}) {
    s.render.max_events = events;
    expect_agreement(s, 400, 0.15);
  }
}

// The density of points, summed up to the distance that a number draws, is that number: for vertices close to the lamp,
// on the ball's rim and far away.
TEST(LitBalls, DrawPointsByTheirDensity) {
  const LitBall ball{nullptr, dvec3(0), 0.7, 1, 1};
  for (const double h : {0.01, 0.7, 50.0}) {
    const double r = ball.sample(h, 0.6);
    ASSERT_GT(r, 0);
    ASSERT_LT(r, ball.radius);
    constexpr int kSteps = 100000;
    double sum = 0;
    for (int k = 0; k < kSteps; ++k) {
      const double at = (k + 0.5) / kSteps * r;
      sum += ball.density(h, at) * 4 * kPi * at * at * r / kSteps;
    }
    EXPECT_NEAR(sum, 0.6, 1e-4) << h;
  }
  EXPECT_EQ(ball.density(1, 0.71), 0);
}

// Where there is smoke around a lamp, and only there.
TEST(LitBalls, StandAroundLampsInGrids) {
  Scene s = lamps_in_cloud();
  EXPECT_TRUE(PreparedScene(s, {}).plan().lit_balls.empty());  // one grid alone
  add_floor(s);
  EXPECT_EQ(PreparedScene(s, {}).plan().lit_balls.size(), 2u);
  s.lights[1].position = dvec3(0, 0, 40);
  EXPECT_EQ(PreparedScene(s, {}).plan().lit_balls.size(), 1u);
  s.render.near_lights = "off";
  EXPECT_TRUE(PreparedScene(s, {}).plan().lit_balls.empty());
}

TEST(LitBalls, GiveTheSameBitsForAnyNumberOfThreads) {
  Scene s = lamps_in_cloud();
  add_floor(s);
  const PreparedScene prepared(s, {});
  const auto red = [&](int threads) { return prepared.render(4, 1, {threads, {}, nullptr}).layers.at("R"); };
  const Plane one = red(1), three = red(3);
  for (int y = 0; y < one.height(); ++y)
    for (int x = 0; x < one.width(); ++x) ASSERT_EQ(one(x, y), three(x, y)) << x << " " << y;
}

}  // namespace
}  // namespace brume
