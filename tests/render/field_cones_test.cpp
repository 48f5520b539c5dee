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
#include "render/world/camera.h"
#include "tests/support/files.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::demo;

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

struct Mean {
  double value = 0, variance = 0;  // of the picture's mean, from the spread within its pixels
};

/// Means of beauty, light scattered once, light on surfaces, and indirect light.
std::vector<Mean> means(const PreparedScene& scene, const std::function<void(Plan&)>& change, int spp, int64_t seed) {
  PathContext context = scene.context();
  change(context.plan);
  const Camera camera = scene.camera();
  std::vector<Mean> all(12);
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      std::vector<PathRequest> requests;
      for (int s = 0; s < spp; ++s) requests.push_back(scene.request(camera, seed, x, y, static_cast<uint32_t>(s)));
      std::vector<RunningStatistics> pixel(all.size());
      PathCounters counters;
      trace_paths(
          context, requests,
          [&](size_t, const PathSample& s) {
            const dvec3 values[] = {s.beauty, s.single, s.surface, s.indirect};
            for (size_t k = 0; k < all.size(); ++k) pixel[k].add(values[k / 3][static_cast<int>(k % 3)]);
          },
          counters);
      for (size_t k = 0; k < all.size(); ++k) {
        all[k].value += pixel[k].mean / (kSize * kSize);
        all[k].variance += pixel[k].mean_variance() / std::pow(kSize, 4);
      }
    }
  return all;
}

Scene fire(const std::function<void(Scene&)>& change) {
  Scene scene = demo("fire", kSize);
  scene.film.height = kSize;
  change(scene);
  return scene;
}

/// With its floor, and dense smoke beside it that samples the fire; alone under a sky; in colours.
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

// 5 standard errors of the difference: biases of 3 % of the beauty would be found.
TEST(FieldCones, AimedPathsHaveTheMeansOfOthers) {
  for (const auto& [name, scene] : scenes()) {
    const PreparedScene prepared(scene, LayerRequest::of({"single", "surface", "indirect"}, true));
    ASSERT_TRUE(prepared.plan().aims_at_fire) << name;
    const std::vector<Mean> aimed = means(
        prepared, [](Plan&) {}, 192, 1);
    const std::vector<Mean> others = means(
        prepared, [](Plan& plan) { plan.aims_at_fire = false; }, 384, 2);
    for (size_t k = 0; k < aimed.size(); ++k) {
      const double error = std::sqrt(aimed[k].variance + others[k].variance);
      EXPECT_NEAR(aimed[k].value, others[k].value, 5 * error + 1e-9) << name << ": value " << k;
    }
    EXPECT_LT(5 * std::sqrt(aimed[0].variance + others[0].variance), 0.03 * aimed[0].value) << name;
  }
}

}  // namespace
}  // namespace brume
