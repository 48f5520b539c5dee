// Directions towards fire: the density that they state, and the same means as without.

#include "render/world/field_cones.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "base/running_statistics.h"
#include "render/session/renderer.h"
#include "render/transport/wavefront.h"
#include "tests/support/files.h"
#include "tests/support/fire_pictures.h"
#include "tests/support/media_scenes.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::PictureMean;

constexpr int kSize = 24;

dvec3 on_sphere(Rng& rng) {
  dvec3 d;
  do {
    d = 2.0 * dvec3(rng.uniform(), rng.uniform(), rng.uniform()) - 1.0;
  } while (glm::dot(d, d) > 1 || glm::dot(d, d) < 1e-6);
  return glm::normalize(d);
}

/// Smoke all around.
Medium smoke(double sigma_t, double albedo) {
  return {HomogeneousShape{HomogeneousShape::Shape::kBox, dvec3(-50), dvec3(50)},
          dmat4(1),
          {dvec3(sigma_t), dvec3(albedo)},
          PhaseFunction::henyey_greenstein(0)};
}

FieldCones some_cones(const dvec3& p, const dvec3& normal) {
  FieldCones cones;
  const Medium media[] = {smoke(2, 0.7)};
  FieldBalls({{2, {3, 0, 0}, 0.5}, {1, {3, 1, 0.5}, 0.25}, {4, {2, 1, 2}, 0.1}, {1, {-1, 2, 0}, 0.3}}, media)
      .add_cones(p, normal, cones);
  cones.finish(0.5);
  return cones;
}

// Means of a function of the direction: of directions drawn, and of all directions, by the stated density. A density
// wrong by 1 % would be found.
TEST(FieldCones, DirectionsHaveTheStatedDensity) {
  for (const dvec3& p : {dvec3(0), dvec3(2, 1, 2.1), dvec3(-20, 3, 1)})
    for (const dvec3& normal : {dvec3(0), dvec3(0, 0, 1)}) {
      const FieldCones cones = some_cones(p, normal);
      ASSERT_GT(cones.share(), 0);
      ASSERT_LT(cones.share(), 1);
      RunningStatistics drawn, stated, all;
      Rng rng(7);
      const auto f = [](const dvec3& d) { return 1.5 + d.x + 0.5 * d.y * d.z; };
      for (int k = 0; k < 400000; ++k) {
        const dvec3 d = cones.sample(rng.uniform(), {rng.uniform(), rng.uniform()});
        ASSERT_GT(cones.pdf(d * (1 - 1e-12)), 0);
        drawn.add(f(d));
        // Half of the directions are drawn, half are uniform.
        const dvec3 e = k % 2 ? d : on_sphere(rng);
        const double weight = cones.pdf(e) / (0.5 * cones.pdf(e) + 0.5 / (4 * kPi));
        stated.add(f(e) * weight);
        all.add(weight);
      }
      EXPECT_NEAR(all.mean, 1, 5 * std::sqrt(all.mean_variance()) + 1e-3);
      EXPECT_NEAR(drawn.mean, stated.mean, 5 * std::sqrt(drawn.mean_variance() + stated.mean_variance()));
      EXPECT_LT(5 * std::sqrt(stated.mean_variance()), 0.02);
    }
}

// Directions to balls that are small from afar, as paths take them: in single precision, which may round them out of
// their cone. Of the density that counts for a vertex that scatters evenly, the weights of directions in the cone add
// up to its solid angle, be the direction drawn by the cone, whose density is told before it is rounded, or by chance.
// Wrong by 2 % would be found; weights of what was rounded out made the sum 270 times as large.
TEST(FieldCones, NarrowConesKeepTheirDensityInFloats) {
  for (const double sine : {0.3, 0.03, 0.01, 0.003, 0.001}) {
    const Medium media[] = {smoke(2 / sine, 0.7)};
    const dvec3 axis = glm::normalize(dvec3(0.3, -0.7, 0.5));
    FieldCones cones;
    FieldBalls({{1, axis, sine * sine / 2.25}}, media).add_cones(dvec3(0), dvec3(0), cones);
    cones.finish(0);
    const double solid_angle = 2 * kPi * (1 - std::sqrt(1 - sine * sine)), even = 1 / (4 * kPi);
    ASSERT_GT(cones.share(), 0.1);
    RunningStatistics all, narrow;
    Rng rng(3);
    for (int k = 0; k < 200000; ++k) {
      const bool aimed = rng.uniform() < cones.share();
      const dvec3 drawn = aimed ? cones.sample(rng.uniform(), {rng.uniform(), rng.uniform()}) : on_sphere(rng);
      const dvec3 rounded = dvec3(vec3(drawn));
      const double weight = even / cones.mixed(even, cones.pdf(aimed ? drawn : rounded));
      all.add(weight);
      narrow.add(glm::dot(axis, drawn) >= std::sqrt(1 - sine * sine) - 1e-6 ? weight / even : 0.0);
      if (aimed) {
        EXPECT_NEAR(cones.pdf(drawn), 1 / solid_angle, 1e-3 / solid_angle) << sine;
        EXPECT_NEAR(cones.pdf(1.001 * drawn), 1 / solid_angle, 1e-3 / solid_angle) << sine;
      }
    }
    EXPECT_NEAR(all.mean, 1, 0.01) << sine;
    EXPECT_NEAR(narrow.mean, solid_angle, 0.02 * solid_angle + 5 * std::sqrt(narrow.mean_variance())) << sine;
  }
}

// Smoke so far from a glowing ball of smoke that all that comes from there comes from one direction: its light is that
// of the ball's intensity, which a camera measures from nearby. Its radius is 4e-2 to 1e-3 of the distance.
TEST(FieldCones, FarSmokeGetsTheLightOfTheIntensity) {
  Scene near_by = test::through_the_middle(kSize);
  near_by.camera.type = "orthographic";
  near_by.camera.width = 2;
  near_by.volumes = {test::solid("sphere", 2, 0.9)};
  near_by.volumes[0].emission = dvec3(1);
  const double radiance = test::mean_radiance(PreparedScene(near_by, {}).render(64, 1).layers).value.x,
               intensity = 4 * radiance;
  for (const double distance : {30.0, 100.0, 300.0, 1000.0}) {
    Scene far = near_by;
    far.volumes[0].emission *= distance * distance;  // so that the smoke is as bright at any distance
    far.volumes[0].object_to_world = test::translation({-distance, 0, 0});
    far.camera.width = 0.1;
    far.volumes.push_back(test::solid("box", 0.02, 0.5));
    far.volumes[1].lo = {-0.5, -5, -0.5}, far.volumes[1].hi = {0.5, 5, 0.5};
    const PreparedScene prepared(far, {});
    ASSERT_TRUE(prepared.plan().aims_at_fire);
    const test::Mean seen = test::mean_radiance(prepared.render(1024, 1).layers);
    const double expected = 0.5 * (1 - std::exp(-0.2)) * std::exp(-0.01) * intensity / (4 * kPi);
    EXPECT_NEAR(seen.value.x, expected, 0.04 * expected) << distance;
    EXPECT_LT(5 * seen.error.x, 0.04 * expected) << distance;
  }
}

// A brick that one voxel lights at a corner has no extent but the voxel's.
TEST(FieldCones, OneLitVoxelHasACone) {
  const test::TemporaryFolder folder;
  for (int k = 0; k < 9; ++k) {
    const auto path = folder / "voxel.vdb";
    const VoxelBox box{ivec3(0), ivec3(16)};
    test::write_grids_vdb(path, box,
                          {{"density", [](const ivec3&) { return 1.0f; }},
                           {"flame", [k](const ivec3& v) { return v == ivec3(k) ? 1.0f : 0.0f; }}},
                          0.1);
    Scene scene = test::scene_of(path, 5, 0.7, 0);
    scene.volumes[0].flame_grid = "flame";
    scene.volumes[0].flame_intensity = 1;
    const PreparedScene prepared(scene, {});
    const FieldCones cones = prepared.lights().field_cones({3, 0, 0});
    ASSERT_GT(cones.share(), 0) << k;
    Rng rng(1);
    for (int n = 0; n < 100; ++n) {
      const double pdf = cones.pdf(cones.sample(rng.uniform(), {rng.uniform(), rng.uniform()}));
      ASSERT_TRUE(pdf > 0 && pdf < 1e4) << k << ": " << pdf;
    }
  }
}

TEST(FieldCones, NothingFacesLightBehindASurface) {
  FieldCones cones;
  const Medium media[] = {smoke(2, 0.7)};
  FieldBalls({{1, {0, 0, -5}, 0.01}}, media).add_cones(dvec3(0), {0, 0, 1}, cones);
  EXPECT_TRUE(cones.empty());
}

double share_with(const std::vector<Medium>& media) {
  FieldCones cones;
  FieldBalls({{1, {5, 0, 0}, 0.1}}, media).add_cones(dvec3(0), dvec3(0), cones);
  cones.finish(0);
  return cones.share();
}

// What a field emits is left to light samples, which find it better.
TEST(FieldCones, SmokeThatScattersTellsHowManyDirectionsAimAtIt) {
  EXPECT_EQ(share_with({}), 0);
  EXPECT_EQ(share_with({smoke(10, 0)}), 0);
  EXPECT_EQ(share_with({smoke(0, 0.9)}), 0);
  const double thin = share_with({smoke(1e-3, 0.5)}), thick = share_with({smoke(1e3, 0.5)});
  EXPECT_GT(thin, 0);
  EXPECT_NEAR(share_with({smoke(2e-3, 0.5)}), 2 * thin, 0.01 * thin);
  EXPECT_NEAR(share_with({smoke(1e-3, 0.5), smoke(2e-3, 0.25)}), 2 * thin, 0.01 * thin);
  EXPECT_GT(thick, 100 * thin);
  EXPECT_LT(thick, 0.5);
}

/// Means of beauty, light scattered once, light on surfaces, and indirect light.
std::vector<PictureMean> means(const PreparedScene& scene, const std::function<void(Plan&)>& change, int spp,
                               int64_t seed) {
  PathContext context = scene.context();
  change(context.plan);
  return test::picture_means(scene, context, kSize, 12, spp, seed, [](const PathSample& s, size_t k) {
    const dvec3 values[] = {s.beauty, s.single, s.surface, s.indirect};
    return values[k / 3][static_cast<int>(k % 3)];
  });
}

Scene fire(const std::function<void(Scene&)>& change) {
  return test::fire_picture(kSize, change);
}

/// With its floor, and dense smoke beside it; alone under a sky; in colours.
std::vector<std::pair<const char*, Scene>> scenes() {
  return {{"over a floor", fire([](Scene& s) {
             s.volumes.push_back(s.volumes[0]);
             s.volumes[1].temperature_grid = "none";
             s.volumes[1].object_to_world[3] += glm::dvec4(2.5, 0, 0, 0);
             s.volumes[1].albedo = dvec3(0.8);
             s.camera.fov = 50;
           })},
          {"under a sky", fire([](Scene& s) {
             s.surfaces.clear();
             s.environment.radiance = dvec3(2, 3, 4);
           })},
          {"in colours", fire([](Scene& s) { s.volumes[0].sigma_t *= dvec3(1, 0.6, 0.3); })}};
}

// Aimed from every medium, the fire's own, too. 5 standard errors of the difference: biases of 3 % of the beauty would
// be found.
TEST(FieldCones, AimedPathsHaveTheMeansOfOthers) {
  for (const auto& [name, scene] : scenes()) {
    const PreparedScene prepared(scene, LayerRequest::of({"single", "surface", "indirect"}, true));
    ASSERT_TRUE(prepared.lights().any_scattered_field()) << name;
    const auto aiming = [](bool aims) {
      return [aims](Plan& plan) {
        plan.aims_at_fire = aims;
        plan.far_from_fire.assign(plan.media.size(), true);
      };
    };
    const std::vector<PictureMean> aimed = means(prepared, aiming(true), 192, 1);
    const std::vector<PictureMean> others = means(prepared, aiming(false), 384, 2);
    for (size_t k = 0; k < aimed.size(); ++k) {
      const double error = std::sqrt(aimed[k].variance + others[k].variance);
      EXPECT_NEAR(aimed[k].value, others[k].value, 5 * error + 1e-9) << name << ": value " << k;
    }
    EXPECT_LT(5 * std::sqrt(aimed[0].variance + others[0].variance), 0.03 * aimed[0].value) << name;
  }
}

}  // namespace
}  // namespace brume
