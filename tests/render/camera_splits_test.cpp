// Several paths from one camera ray: the same means as one path, in every layer, with the statistics that say so.

#include "render/transport/camera_splits.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "base/running_statistics.h"
#include "render/session/renderer.h"
#include "render/transport/wavefront.h"
#include "tests/support/files.h"
#include "tests/support/fire_pictures.h"
#include "tests/support/reference_frame.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::demo;
using test::PictureMean;

constexpr int kSize = 24;

/// Means of all members of a PathSample, and of the groups' light, over a picture.
std::vector<PictureMean> means(const PreparedScene& scene, int paths, int spp, int64_t seed) {
  PathContext context = scene.context();
  context.plan.first_collision.paths = PathCounts(paths);
  constexpr size_t kValues = offsetof(PathSample, groups) / sizeof(double);
  const size_t groups = 3 * 4 * context.lights->groups().size();  // PathSample::groups
  return test::picture_means(
      scene, context, kSize, kValues + groups, spp, seed, [](const PathSample& sample, size_t k) {
        return k < kValues ? sample.values()[k] : sample.groups[(k - kValues) / 3][static_cast<int>((k - kValues) % 3)];
      });
}

Scene fire(const std::function<void(Scene&)>& change) {
  return test::fire_picture(kSize, change);
}

/// Fire alone, whose first collisions are forced; over its floor; in colours; behind a holdout and a shadow catcher.
std::vector<std::pair<const char*, Scene>> scenes() {
  return {{"alone", fire([](Scene& s) { s.surfaces.clear(); })},
          {"over a floor", fire([](Scene&) {})},
          {"in colours", fire([](Scene& s) { s.volumes[0].sigma_t *= dvec3(1, 0.6, 0.3); })},
          {"on a shadow catcher", fire([](Scene& s) { s.surfaces[0].role = "shadow_catcher"; })},
          {"behind a holdout", fire([](Scene& s) { s.surfaces.back().role = "holdout"; })},
          {"of groups", fire([](Scene& s) {
             s.volumes[0].group = "fire";
             for (LightSettings& light : s.lights) light.group = "lamps";
           })}};
}

// 5.5 standard errors of the difference: biases of 3 % of the beauty, of 12 % of light scattered once would be found.
TEST(CameraSplits, HaveTheMeansOfOnePathInEveryLayer) {
  for (const auto& [name, scene] : scenes()) {
    LayerRequest layers = LayerRequest::of({"all"}, true);
    layers.guides = layers.motion = layers.matte_objects = layers.matte_materials = false;
    layers.names.emplace_back("light_aimed");
    const PreparedScene prepared(scene, layers);
    ASSERT_TRUE(prepared.plan().seen_emission) << name;
    const std::vector<PictureMean> one = means(prepared, 1, 256, 1), four = means(prepared, 4, 128, 2);
    for (size_t k = 0; k < one.size(); ++k) {
      const double error = std::sqrt(one[k].variance + four[k].variance);
      EXPECT_NEAR(one[k].value, four[k].value, 5.5 * error + 1e-7 * std::abs(one[k].value))
          << name << ": value " << k << " of a sample";
    }
    const auto error = [&](size_t k) { return std::sqrt(one[k].variance + four[k].variance) / one[k].value; };
    constexpr size_t kSingle = offsetof(PathSample, single) / sizeof(double);
    EXPECT_LT(5.5 * error(0), 0.03) << name << ": beauty";
    EXPECT_LT(5.5 * error(kSingle), 0.12) << name << ": what is scattered once";
    // Of half as many camera rays. What is left of one path's spread is that of the pixels' areas.
    EXPECT_LT(four[kSingle].variance, 1.5 * one[kSingle].variance) << name;
  }
}

// A scene without fire has one path for each ray, and so have path records, which tell of one.
TEST(CameraSplits, ArePlannedWhereCameraRaysSeeFire) {
  const auto paths = [](const Scene& scene, bool records) {
    LayerRequest layers;
    layers.records = records;
    return PreparedScene(scene, layers).plan().first_collision.paths.most();
  };
  EXPECT_GT(paths(demo("fire", kSize), false), 1);
  EXPECT_EQ(paths(demo("fire", kSize), true), 1);
  EXPECT_EQ(paths(demo("smoke", kSize), false), 1);
  EXPECT_EQ(paths(demo("cloud", kSize), false), 1);
}

TEST(CameraSplits, HaveTheSameBitsForAllThreadsAndInstructionSets) {
  for (const auto& [name, scene] : {scenes()[0], scenes()[1]}) {
    const PreparedScene prepared(scene, LayerRequest::of({"direct", "indirect", "albedo"}, true));
    ASSERT_GT(prepared.plan().first_collision.paths.most(), 1) << name;
    const Layers best = prepared.render(4, 1, {}).layers;
    test::expect_same_bits(best, prepared.render(4, 1, {1, {}, nullptr}).layers, "one thread");
    test::on_every_target(
        [&](const std::string& target) { test::expect_same_bits(best, prepared.render(4, 1, {}).layers, target); });
  }
}

// The variance that a frame states is that of its pixels from seed to seed, where all camera rays are the same one. A
// difference of 15 % would be found.
TEST(CameraSplits, StateTheVarianceOfTheirPixels) {
  const PreparedScene prepared(fire([](Scene& s) {
                                 s.surfaces.clear();
                                 s.camera.type = "orthographic";
                                 s.camera.width = 1e-6;
                                 s.camera.position = {0, -5, 0.5}, s.camera.look_at = {0, 0, 0.5};
                               }),
                               LayerRequest::of({"single"}, true));
  ASSERT_GT(prepared.plan().first_collision.paths.most(), 1);
  double stated = 0, found = 0;
  for (int seed = 0; seed < 8; ++seed) {
    const Layers a = prepared.render(16, 2 * seed).layers, b = prepared.render(16, 2 * seed + 1).layers;
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x) {
        const auto d = static_cast<double>(a.at("single.G")(x, y) - b.at("single.G")(x, y));
        found += 0.5 * d * d;
        stated +=
            0.5 * static_cast<double>(a.at("single.mean_variance.G")(x, y) + b.at("single.mean_variance.G")(x, y));
      }
  }
  EXPECT_NEAR(found / stated, 1, 0.15);
}

}  // namespace
}  // namespace brume
