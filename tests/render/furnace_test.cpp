// A white furnace: albedo 1 and radiance 1 from everywhere make every pixel 1, whatever the density, g and transform.

#include <gtest/gtest.h>

#include <cmath>

#include "base/running_statistics.h"
#include "image/exr_io.h"
#include "render/session/renderer.h"
#include "render/transport/wavefront.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

Scene furnace(const std::filesystem::path& volume, double g) {
  Scene scene = test::scene_of(volume, 40, 1.0, g);
  scene.environment.radiance = dvec3(1);
  scene.film.width = scene.film.height = 32;
  return scene;
}

TEST(WhiteFurnace, EveryPathIsExactlyOneWithoutLightSampling) {
  // A real volume, turned, squeezed and mirrored in the world.
  Rng rng(1);
  for (const double g : {0.0, 0.6, -0.95, 0.99}) {
    Scene scene = furnace(test::source("data/volumes/cloud.vdb"), g);
    scene.volumes[0].object_to_world = test::random_affine(rng);
    scene.camera.look_at = dvec3(scene.volumes[0].object_to_world[3]);
    scene.camera.position = scene.camera.look_at + dvec3(1, -9, 2);
    scene.render.first_collision =
        "free";  // forced ones play roulette with faint paths: ForcedFirstCollisionsLoseNothing
    const RenderResult r = PreparedScene(scene, {}).render(16, 1, {});
    EXPECT_GT(r.report.counters.tracking.collisions, 10000u) << "the picture shows no medium";
    EXPECT_EQ(r.report.counters.capped_paths, 0u);
    for (const LayerName& l : {layer::beauty})
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < 32; ++y)
          for (int x = 0; x < 32; ++x) {
            ASSERT_NEAR(r.layers.at(l.channel(c))(x, y), 1.0f, 2e-7f);
            ASSERT_EQ(r.layers.at("mean_variance.R")(x, y), 0.0f) << "a path returned something else than 1";
          }
  }
}

// Optical depth 100 and no absorption: walks of thousands of events, none of them cut, each exactly 1.
TEST(WhiteFurnace, PathsOfThousandsOfEventsEndWhole) {
  const test::TemporaryFolder folder;
  test::write_affine_vdb(folder / "slab.vdb", {{-8, -8, -10}, {8, 8, 10}}, test::scaling(dvec3(1e5, 1e5, 0.05)),
                         [](const ivec3&) { return 1.0f; });
  Scene scene = furnace(folder / "slab.vdb", 0.0);
  scene.volumes[0].sigma_t = dvec3(100 / 1.05);
  scene.camera.position = dvec3(0, 0, 50);
  scene.camera.look_at = dvec3(0);
  scene.camera.up = dvec3(0, 1, 0);
  const RenderResult r = PreparedScene(scene, {}).render(16, 1, {});
  EXPECT_GT(r.report.counters.longest, 3000u);
  EXPECT_EQ(r.report.counters.capped_paths, 0u);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) ASSERT_NEAR(r.layers.at("R")(x, y), 1.0f, 2e-7f);
}

// 1e6 paths: with light sampling of a constant sky and of a lat-long picture of ones. Deviations above 5 standard
// errors (about 0.2 %) would be found.
TEST(WhiteFurnace, IsOneWithLightSampling) {
  const test::TemporaryFolder folder;
  Layers ones(16, 8);
  for (const Plane* p : ones.add_rgb(layer::beauty)) const_cast<Plane*>(p)->fill(1.0f);
  write_exr(folder / "ones.exr", ones);
  for (const bool picture : {false, true})
    for (const double g : {0.0, 0.8}) {
      Scene scene = furnace(test::source("data/volumes/cloud.vdb"), g);
      scene.render.light_sampling = "all";
      if (picture) scene.environment.file = folder / "ones.exr";
      const RenderResult r = PreparedScene(scene, {}).render(1000, 3, {});
      const test::Mean mean = test::mean_radiance(r.layers);
      EXPECT_GT(mean.error.x, 0);
      EXPECT_NEAR(mean.value.x, 1.0, 5 * mean.error.x) << "picture " << picture << ", g " << g;
      EXPECT_LT(mean.error.x, 1e-3);
    }
}

// Paths entering a convex boundary of area S with cosine-distributed directions scatter 4 int sigma_s dV / S times on
// average, whatever g and heterogeneity. The boundary is a sphere around a real cloud; 400000 paths, 5 standard errors
// are below 1.5 %.
TEST(CollisionCount, IsFourTimesTheMassOverTheSurface) {
  for (const double g : {0.0, 0.85}) {
    const ScalarField field = load_scalar(test::source("data/volumes/cloud.vdb"), {});
    Rng rng(11);
    const dmat4 turn = test::random_affine(rng);
    Medium medium(field.bricks, turn * field.world_from_index, 4.0, dvec3(1), g);
    double mass = 0;
    ivec3 v;
    const ivec3 end(field.bricks.support_hi());
    for (v.x = 0; v.x <= end.x; ++v.x)
      for (v.y = 0; v.y <= end.y; ++v.y)
        for (v.z = 0; v.z <= end.z; ++v.z) mass += field.bricks.voxel(v);
    mass *= medium.voxel_volume() * 4.0;
    const Medium::Sphere sphere = medium.bounding_sphere();
    const double expected = 4 * mass / (4 * kPi * sphere.radius * sphere.radius);

    medium.set_majorants(1, true);
    Lights lights;
    PathContext context;
    context.media = {&medium, 1};
    context.lights = &lights;
    context.plan.media = {Precision::kDouble};
    context.max_events = context.roulette_start = 1000000;
    RunningStatistics count;
    for (uint32_t i = 0; i < 400000; ++i) {
      const dvec3 n = test::random_direction(rng);
      const double sin2 = rng.uniform();
      const SinCos phi = portable_sincos_2pi(rng.uniform());
      const dvec3 d = Frame(-n).to_world({std::sqrt(sin2) * phi.cos, std::sqrt(sin2) * phi.sin, std::sqrt(1 - sin2)});
      PathCounters counters;
      const PathRequest request{{sphere.centre + sphere.radius * n, d}, 0, {17, 0, i, 0}};
      trace_paths(
          context, {&request, 1}, [](size_t, const PathSample&) {}, counters);
      count.add(static_cast<double>(counters.tracking.collisions));
    }
    EXPECT_NEAR(count.mean, expected, 5 * std::sqrt(count.mean_variance()));
    EXPECT_LT(5 * std::sqrt(count.mean_variance()), 0.03 * expected);
  }
}

}  // namespace
}  // namespace brume
