#include "render/world/light_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <set>

#include "base/rng.h"
#include "base/running_statistics.h"
#include "render/world/lights.h"

namespace brume {
namespace {

dvec3 uniform3(Rng& rng, double lo, double hi) {
  const auto one = [&] { return lo + (hi - lo) * rng.uniform(); };
  const double x = one(), y = one(), z = one();
  return {x, y, z};
}

/// Points, spots, spheres and rectangles in a box of size 2, some of them in the same place.
std::vector<LightSettings> many_lights(size_t count) {
  Rng rng(7);
  std::vector<LightSettings> lights;
  const char* const kinds[] = {"point", "spot", "sphere", "rectangle"};
  for (size_t i = 0; i < count; ++i) {
    LightSettings s;
    s.type = kinds[i % 4];
    s.position = i % 9 == 5 ? dvec3(0.5) : uniform3(rng, -1, 1);
    s.intensity = s.radiance = std::pow(10.0, 2 * rng.uniform()) * uniform3(rng, 0.1, 1);
    s.direction = uniform3(rng, -1, 1);
    s.cone_angle = 60;
    s.radius = 0.002 + 0.05 * rng.uniform();
    s.edge_x = 0.1 * uniform3(rng, -1, 1);
    s.edge_y = 0.1 * uniform3(rng, -1, 1);
    lights.push_back(s);
  }
  return lights;
}

Scene scene_of(const std::vector<LightSettings>& lights) {
  Scene scene;
  scene.environment.radiance = dvec3(0);
  scene.lights = lights;
  return scene;
}

/// Of a scene's lights, in their order.
std::vector<const Light*> standing(const Lights& lights) {
  std::vector<const Light*> all(lights.finite().begin(), lights.finite().end());
  all.insert(all.end(), lights.points().begin(), lights.points().end());
  return all;
}

const dvec3 kPlaces[] = {{0, 0, 0}, {0.31, -0.22, 0.9}, {3, 1, -2}, {40, 0, 0}, {0.5, 0.5, 0.501}};

TEST(LightTree, PicksWithTheProbabilitiesThatItSays) {
  for (const size_t count : {1u, 2u, 3u, 5u, 60u, 400u}) {
    const Lights lights(scene_of(many_lights(count)), dvec3(0));
    const std::vector<const Light*> all = standing(lights);
    const LightTree tree(all);
    Rng rng(3);
    for (const dvec3& p : kPlaces) {
      double sum = 0;
      std::vector<double> probability;
      for (size_t i = 0; i < all.size(); ++i) {
        probability.push_back(tree.probability(tree.cut(p), p, i));
        EXPECT_GT(probability.back(), 0);
        sum += probability.back();
      }
      EXPECT_NEAR(sum, 1, 1e-9);
      std::vector<double> found(all.size());
      constexpr int kPicks = 20000;
      for (int k = 0; k < kPicks; ++k) {
        const auto [light, stated] = tree.pick(tree.cut(p), p, rng.uniform());
        const auto i = static_cast<size_t>(std::find(all.begin(), all.end(), light) - all.begin());
        ASSERT_LT(i, all.size());
        EXPECT_NEAR(stated, probability[i], 1e-9 * stated);
        ++found[i];
      }
      // Chi-square over the lights that are expected often enough: mean k, variance 2 k.
      double chi2 = 0;
      int cells = 0;
      for (size_t i = 0; i < all.size(); ++i) {
        const double expected = kPicks * probability[i];
        if (expected < 5) continue;
        chi2 += (found[i] - expected) * (found[i] - expected) / expected;
        ++cells;
      }
      EXPECT_LT(chi2, cells + 6 * std::sqrt(2.0 * cells)) << count;
    }
  }
}

TEST(LightTree, FindsAllThatARayMeets) {
  const Lights lights(scene_of(many_lights(300)), dvec3(0));
  const std::vector<const Light*> finite(lights.finite().begin(), lights.finite().end());
  const LightTree tree(finite);
  Rng rng(4);
  size_t met = 0, visited = 0;
  for (int k = 0; k < 20000; ++k) {
    const Ray ray{uniform3(rng, -2, 2), glm::normalize(uniform3(rng, -1, 1))};
    std::set<size_t> found;
    tree.along(ray, 1.5, [&](size_t i) { found.insert(i); });
    visited += found.size();
    for (size_t i = 0; i < finite.size(); ++i) {
      const double t = lights.finite()[i]->intersect(ray);
      if (t > 0 && t < 1.5) {
        EXPECT_TRUE(found.contains(i));
        ++met;
      }
    }
  }
  EXPECT_GT(met, 100u);
  EXPECT_LT(visited, 20000 * finite.size() / 10);
}

// A wrong probability of half a per cent of the light would be found.
TEST(LightTree, ManyLightsBringWhatEachBringsAlone) {
  Lights lights(scene_of(many_lights(200)), dvec3(0));
  lights.finish("auto");
  for (const dvec3& p : kPlaces) {
    Rng rng(5);
    double exact = 0;
    RunningStatistics chosen;
    for (const Light* light : standing(lights)) {
      constexpr int kAcross = 40;
      for (int i = 0; i < kAcross * kAcross; ++i) {
        const LightSample s = light->sample(p, (dvec2(i % kAcross, i / kAcross) + 0.5) / static_cast<double>(kAcross));
        if (s.pdf > 0) exact += luminance(s.radiance) / s.pdf / (kAcross * kAcross);
      }
    }
    for (int k = 0; k < 200000; ++k) {
      const LightSample s = lights.choice().sample(p, rng.uniform(), {rng.uniform(), rng.uniform()});
      chosen.add(s.pdf > 0 ? luminance(s.radiance) / s.pdf : 0.0);
    }
    EXPECT_NEAR(chosen.mean / exact, 1, 5 * std::sqrt(chosen.mean_variance()) / exact + 2e-3);
    EXPECT_LT(5 * std::sqrt(chosen.mean_variance()) / exact, 0.05);
  }
}

TEST(LightTree, FewLightsStandForMany) {
  std::vector<LightSettings> settings = many_lights(1000);
  for (LightSettings& s : settings) s.type = "point";
  const Lights lights(scene_of(settings), dvec3(0));
  const std::vector<const Light*> all = standing(lights);
  const LightTree tree(all);
  Rng rng(6);
  double worst = 0;
  for (int k = 0; k < 200; ++k) {
    const dvec3 p = uniform3(rng, -2, 2);
    dvec3 exact(0), stood(0);
    for (const Light* light : all) exact += light->sample(p, dvec2(0.5)).radiance;
    const auto stands = tree.stands(p, 0.03);
    EXPECT_LT(stands.size(), 300u);
    for (const LightTree::Stand& stand : stands)
      stood += luminance(all[stand.number]->sample(p, dvec2(0.5)).radiance) * stand.factor;
    worst = std::max(worst, max_component(glm::abs(stood / exact - 1.0)));
  }
  EXPECT_LT(worst, 0.2);
}

}  // namespace
}  // namespace brume
