// How many paths go on from camera rays: a constant of the scene that spares time where light is smooth.

#include "render/transport/path_counts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/fire_pictures.h"
#include "tests/support/targets.h"

namespace brume {
namespace {

constexpr int kSize = 24;

Scene fire_on_floor() {
  return test::fire_picture(kSize, [](Scene&) {});
}

std::vector<int> counts(const PreparedScene& scene) {
  std::vector<int> all;
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) all.push_back(scene.plan().first_collision.paths.at(x, y));
  return all;
}

TEST(PathCounts, AreTheSameForAllThreadsAndInstructionSets) {
  const std::vector<int> best = counts(PreparedScene(fire_on_floor(), {}));
  EXPECT_EQ(counts(PreparedScene(fire_on_floor(), {}, {1, {}, nullptr})), best);
  test::on_every_target(
      [&](const std::string& target) { EXPECT_EQ(counts(PreparedScene(fire_on_floor(), {})), best) << target; });
}

TEST(PathCounts, DifferOverThePicture) {
  const PreparedScene scene(fire_on_floor(), {});
  const std::vector<int> all = counts(scene);
  const std::set<int> kinds(all.begin(), all.end());
  EXPECT_GE(*kinds.begin(), 1);
  EXPECT_LE(*kinds.rbegin(), PathCounts::kMost);
  EXPECT_GT(kinds.size(), 2);
  EXPECT_EQ(scene.plan().first_collision.paths.most(), *kinds.rbegin());
}

// Independent paths, one for each ray, find more than twice the relative variance where counts are above the mean.
TEST(PathCounts, AreHighWhereLightIsNoisy) {
  const PreparedScene scene(fire_on_floor(), {});
  const PathCounts& paths = scene.plan().first_collision.paths;
  PathContext context = scene.context();
  context.plan.first_collision.paths = PathCounts(1);
  const Camera camera = scene.camera();
  RunningStatistics high, low;
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      std::vector<PathRequest> requests;
      for (uint32_t s = 0; s < 64; ++s) requests.push_back(scene.request(camera, 1, x, y, s));
      RunningStatistics light;
      PathCounters counters;
      trace_paths(
          context, requests, [&](size_t, const PathSample& s) { light.add(s.beauty.x - s.emission.x); }, counters);
      (paths.at(x, y) > paths.mean() ? high : low).add(light.sample_variance() / (light.mean * light.mean + 0.01));
    }
  EXPECT_GT(high.mean, 2 * low.mean) << high.count << " and " << low.count << " pixels";
}

// Light of the picture, from independent samples: a bias of 2 % would be found.
TEST(PathCounts, KeepTheMean) {
  const PreparedScene scene(fire_on_floor(), {});
  PathContext one = scene.context();
  one.plan.first_collision.paths = PathCounts(1);
  const auto beauty = [](const PathSample& s, size_t) { return s.beauty.x; };
  const test::PictureMean a = test::picture_means(scene, one, kSize, 1, 512, 3, beauty)[0];
  const test::PictureMean b = test::picture_means(scene, scene.context(), kSize, 1, 512, 4, beauty)[0];
  const double error = std::sqrt(a.variance + b.variance);
  EXPECT_NEAR(a.value, b.value, 4 * error);
  EXPECT_LT(4 * error, 0.02 * a.value);
}

// A picture one pixel high, and one with fewer pixels than points are looked at, have their counts, too.
TEST(PathCounts, OfSmallPictures) {
  for (const ivec2& size : {ivec2(1, 1), ivec2(7, 1), ivec2(3, 50)}) {
    Scene s = fire_on_floor();
    s.film.width = size.x, s.film.height = size.y;
    const PreparedScene scene(std::move(s), {});
    const PathCounts& paths = scene.plan().first_collision.paths;
    for (int y = 0; y < size.y; ++y)
      for (int x = 0; x < size.x; ++x) {
        EXPECT_GE(paths.at(x, y), 1);
        EXPECT_LE(paths.at(x, y), paths.most());
      }
  }
}

}  // namespace
}  // namespace brume
