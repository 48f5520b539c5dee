#include <gtest/gtest.h>

#include <cmath>

#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/media_scenes.h"
#include "tests/support/volumes.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

using test::sun;

// The motion of the medium over the shutter: a velocity that is the same everywhere is a straight motion of the volume;
// both against the mean of pictures of the volume standing at times of the shutter. No majorant may be passed.

TEST(MotionBlur, VelocityIsTheMotionItDescribes) {
  const auto path = test::shared("volumes/sequence/smoke_seq_0030.vdb");
  if (path.empty()) GTEST_SKIP() << "no sequence beside the project";
  Scene s = test::scene_of(path, 15, 0.8, 0.2);
  s.camera.fov = 40;
  s.environment.radiance = dvec3(0.3);
  s.lights.push_back(sun({-0.5, -0.6, 0.7}, 2, 0.5));
  Scene moved = s;
  const dvec3 shift(0.4, 0.1, 0.2);
  moved.camera.shutter = {0, 1};
  moved.volumes[0].object_to_world_end = test::translation(shift);
  const PreparedScene prepared(moved, {});
  EXPECT_TRUE(prepared.plan().moving_media);
  const Layers blurred = prepared.render(400, 1, {}).layers;
  double sum = 0, error = 0;
  constexpr int kTimes = 8;
  for (int k = 0; k < kTimes; ++k) {
    s.volumes[0].object_to_world = test::translation(shift * ((k + 0.5) / kTimes));
    const test::Mean m = test::mean_radiance(PreparedScene(s, {}).render(100, 10 + k, {}).layers);
    sum += m.value.x / kTimes;
    error += m.error.x * m.error.x / (kTimes * kTimes);
  }
  const test::Mean m = test::mean_radiance(blurred);
  EXPECT_NEAR(m.value.x, sum, 4.5 * std::hypot(m.error.x, std::sqrt(error)));

  Scene flowing = s;
  flowing.volumes[0].object_to_world = dmat4(1);
  flowing.camera.shutter = {-0.5, 0.5};
  flowing.volumes[0].velocity_grid = "auto";
  flowing.volumes[0].velocity_scale = 0.068 * 0.0375;
  const PreparedScene flow(flowing, {});
  ASSERT_NE(flow.medium()->displacement(), nullptr);
  const RenderResult r = flow.render(50, 1, {});
  EXPECT_EQ(r.report.counters.tracking.majorant_violations, 0u);
  EXPECT_EQ(r.report.invalid_samples, 0u);
  EXPECT_GT(r.report.counters.tracking.collisions, 1000u);
}

// On a grid made for it: density of a ball, the same velocity everywhere.
TEST(MotionBlur, AConstantVelocityShiftsTheDensity) {
  const test::TemporaryFolder folder;
  const auto ball = [](const ivec3& v) { return static_cast<float>(std::max(0.0, 1 - glm::length(dvec3(v)) / 8)); };
  test::write_affine_vdb(folder / "ball.vdb", {ivec3(-9), ivec3(9)}, test::scaling(dvec3(0.1)), ball);
  test::write_velocity_vdb(folder / "v.vdb", folder / "ball.vdb", {ivec3(-20), ivec3(20)}, dvec3(0.5, 0, 0));
  const ScalarField density = load_scalar(folder / "v.vdb", {});
  std::vector<std::string> notes;
  const Displacement d = load_displacement(folder / "v.vdb", "", density, {1.0, 0.0, 2.0}, notes);
  Medium medium(density.bricks, density.world_from_index, 1.0, dvec3(1), 0);
  medium.set_displacement(d);
  EXPECT_TRUE(medium.moves());
  const Medium late = medium.at_time(0.5);  // one frame after the density's time: 0.5 world units along x
  for (const dvec3& p : {dvec3(0.5, 0, 0), dvec3(0.3, 0.2, -0.1), dvec3(0, 0, 0), dvec3(-0.2, 0, 0)})
    EXPECT_NEAR(late.density(late.to_local(p)), ball(ivec3(0)) * medium.density(medium.to_local(p - dvec3(0.5, 0, 0))),
                1e-5);
  // Bounds hold at every time along random rays.
  Rng rng(3);
  TrackingCounters counters;
  for (int i = 0; i < 3000; ++i) {
    const Medium m = medium.at_time(rng.uniform());
    const dvec3 dir = test::random_direction(rng);
    const Ray ray{test::random_point(rng, dvec3(-0.5), dvec3(1.5)) - 5.0 * dir, dir};
    estimate_transmittance(m, m.to_local(ray), 100, rng, counters);
  }
  EXPECT_EQ(counters.majorant_violations, 0u);
  EXPECT_GT(counters.lookups, 500u);
}

// What glows moves with what scatters: a flame in a flow, on the density's lattice or its own, and a moving volume,
// leave the same streak; it lies half the way further on than the flame at rest.
TEST(MotionBlur, GlowMovesToo) {
  const test::TemporaryFolder folder;
  const auto ball = [](const ivec3& v) { return static_cast<float>(std::max(0.0, 1 - glm::length(dvec3(v)) / 8)); };
  test::write_affine_vdb(folder / "ball.vdb", {ivec3(-9), ivec3(9)}, test::scaling(dvec3(0.1)), ball);
  test::write_velocity_vdb(folder / "v.vdb", folder / "ball.vdb", {ivec3(-20), ivec3(20)}, dvec3(1, 0, 0));
  Scene still = test::scene_of(folder / "v.vdb", 0, 0, 0);
  still.film.width = still.film.height = 24;
  still.camera.position = dvec3(0.4, -8, 0);
  still.camera.look_at = dvec3(0.4, 0, 0);
  still.camera.fov = 30;
  still.volumes[0].emission = dvec3(1);
  struct Streak {
    double light = 0, place = 0;
  };
  const auto streak = [](const Scene& s) {
    const Layers frame = PreparedScene(s, {}).render(400, 1, {}).layers;
    Streak k;
    for (int y = 0; y < 24; ++y)
      for (int x = 0; x < 24; ++x) {
        k.light += frame.at("R")(x, y);
        k.place += frame.at("R")(x, y) * (x + 0.5);
      }
    k.place /= k.light;
    return k;
  };
  const Streak rest = streak(still);
  Scene flows = still;
  flows.camera.shutter = {0, 1};
  Scene moves = flows;
  flows.volumes[0].velocity_grid = "auto";
  moves.volumes[0].object_to_world_end = test::translation({1, 0, 0});
  Scene flame = flows;
  flame.volumes[0].emission = dvec3(0);
  flame.volumes[0].flame_grid = "density";
  flame.volumes[0].flame_intensity = 1;
  Scene flame_rest = still;
  flame_rest.volumes[0].emission = dvec3(0);
  flame_rest.volumes[0].flame_grid = "density";
  const double pixel = 2 * 8 * std::tan(15 * kPi / 180) / 24;  // of the film, at the ball
  for (const Scene& s : {flows, moves}) {
    const Streak k = streak(s);
    EXPECT_NEAR(k.light / rest.light, 1, 0.02);
    EXPECT_NEAR((k.place - rest.place) * pixel, 0.5, 0.02);
  }
  EXPECT_NEAR((streak(flame).place - streak(flame_rest).place) * pixel, 0.5, 0.02);

  Scene box = still;
  box.volumes[0].file.clear();
  box.volumes[0].shape = "sphere";
  const Streak box_rest = streak(box);
  box.camera.shutter = {0, 1};
  box.volumes[0].object_to_world_end = test::translation({1, 0, 0});
  EXPECT_NEAR((streak(box).place - box_rest.place) * pixel, 0.5, 0.02) << "a shape that only glows";
}

}  // namespace
}  // namespace brume
