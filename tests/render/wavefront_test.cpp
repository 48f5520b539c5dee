#include "render/wavefront.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cmath>

#include "image/exr_io.h"
#include "render/renderer.h"
#include "render/scene_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

Scene demo(const char* name, int size) {
  Scene scene = read_scene(test::source(std::string("data/scenes/") + name + ".toml"));
  scene.film.width = scene.film.height = size;
  return scene;
}

// 1, 4, 8 or 16 lanes side by side: each path is its own, so the picture is the same.
TEST(Wavefront, EveryInstructionSetGivesTheSameBits) {
  Scene scene = demo("cloud", 40);
  Layers sky(16, 8);
  Rng rng(3);
  for (Plane* p : sky.add_rgb(layer::beauty))
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 16; ++x) (*p)(x, y) = static_cast<float>(rng.uniform());
  const test::TemporaryFolder folder;
  write_exr(folder / "sky.exr", sky);
  scene.environment.file = folder / "sky.exr";
  scene.environment.radiance = dvec3(1);
  const PreparedScene prepared(scene, LayerRequest::of({"all"}, true));
  ASSERT_TRUE(prepared.plan().lanes);
  const Layers best = prepared.render(4, 1, {}).layers;
  int seen = 0;
  for (int64_t targets = hwy::SupportedTargets(); targets; targets &= targets - 1, ++seen) {
    const int64_t target = targets & -targets;
    hwy::SetSupportedTargetsForTest(target);
    test::expect_same_bits(best, prepared.render(4, 1, {}).layers, hwy::TargetName(target));
  }
  hwy::SetSupportedTargetsForTest(0);
  EXPECT_GT(seen, 1);
}

// Lanes and the general loop are two programs for one expectation, layer by layer. Over 48 x 48 pixels of 64 paths
// each, 4.5 standard errors of the light are below 4.5 %: such a bias of either would be found.
TEST(Wavefront, AgreesWithTheGeneralLoop) {
  for (const char* name : {"cloud", "smoke"}) {
    Scene scene = demo(name, 48);
    const auto render = [&](const char* lanes, int64_t seed) {
      scene.render.lanes = lanes;
      const PreparedScene prepared(scene, LayerRequest::of({"all"}, true));
      EXPECT_EQ(prepared.plan().lanes, std::string(lanes) == "auto");
      return prepared.render(64, seed, {}).layers;
    };
    const Layers a = render("auto", 1), b = render("off", 2);
    for (const RecordedLayer& l : recordable_layers()) {
      double sum_a = 0, sum_b = 0, variance = 0;
      for (size_t c = 0; c < l.name.channels.size(); ++c)
        for (int y = 0; y < 48; ++y)
          for (int x = 0; x < 48; ++x) {
            sum_a += a.at(l.name.channel(c))(x, y);
            sum_b += b.at(l.name.channel(c))(x, y);
            variance += a.at(l.name.channel_of(statistic::mean_variance, c))(x, y) +
                        b.at(l.name.channel_of(statistic::mean_variance, c))(x, y);
          }
      // Channels of one layer are correlated: the variance of their sum is up to three times the sum of theirs. The
      // lamp of the flash image is calibrated from a few thousand paths of either program.
      const double error = 4.5 * std::sqrt(3 * variance);
      EXPECT_NEAR(sum_a, sum_b, error + (l.name == layer::flash ? 0.03 : 1e-3) * std::abs(sum_b))
          << name << " " << l.name.label();
      if (l.name == layer::indirect || l.name == layer::direct) {
        EXPECT_LT(error, 0.045 * sum_b) << name << " " << l.name.label();
      }
    }
  }
}

// A majorant that is looser costs look-ups and changes no mean (TRANSPORT.md section 13): 5 standard errors are about 1
// %.
TEST(Wavefront, MajorantsOfOneTwoAndFiveTimesGiveOneMean) {
  Scene scene = demo("cloud", 48);
  test::Mean first;
  uint64_t lookups = 0;
  for (const double scale : {1.0, 2.0, 5.0})
    for (const char* lanes : {"auto", "off"}) {
      scene.render.majorant_scale = scale;
      scene.render.lanes = lanes;
      const RenderResult r = PreparedScene(scene, {}).render(100, static_cast<int64_t>(scale), {});
      const test::Mean mean = test::mean_radiance(r.layers, layer::indirect);
      if (scale == 1 && std::string(lanes) == "auto") {
        first = mean;
      } else {
        EXPECT_NEAR(mean.value.x, first.value.x, 5 * std::hypot(mean.error.x, first.error.x)) << scale << " " << lanes;
      }
      if (std::string(lanes) == "auto") {
        EXPECT_GT(r.report.counters.tracking.lookups, lookups);
        lookups = r.report.counters.tracking.lookups;
      }
    }
}

TEST(Wavefront, IsTakenOnlyWhereItModelsTheScene) {
  const auto lanes = [](const std::function<void(Scene&)>& change) {
    Scene scene = demo("smoke", 16);
    change(scene);
    return PreparedScene(scene, {}).plan().lanes;
  };
  EXPECT_TRUE(lanes([](Scene&) {}));
  EXPECT_FALSE(lanes([](Scene& s) { s.volumes[0].sigma_t = dvec3(1, 2, 3); }));
  EXPECT_FALSE(lanes([](Scene& s) { s.volumes.push_back(s.volumes[0]); }));
  EXPECT_FALSE(lanes([](Scene& s) { s.volumes[0].emission = dvec3(1); }));
  EXPECT_FALSE(lanes([](Scene& s) { s.volumes[0].phase = "mie"; }));
  EXPECT_FALSE(lanes([](Scene& s) {
    s.lights[0] = {};
    s.lights[0].type = "point", s.lights[0].intensity = dvec3(1);
  }));
}

}  // namespace
}  // namespace brume
