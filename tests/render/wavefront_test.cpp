#include "render/transport/wavefront.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <string>

#include "image/exr_io.h"
#include "render/session/renderer.h"
#include "render/world/camera.h"
#include "tests/support/files.h"
#include "tests/support/random_scene.h"
#include "tests/support/reference_frame.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"
#include "volume/tracking.h"

namespace brume {
namespace {

using test::demo;

/// Every layer that paths record, and none of those that guides compute.
LayerRequest every_recorded_layer() {
  LayerRequest layers = LayerRequest::of({"all"}, true);
  layers.guides = false;
  return layers;
}

/// Holds the light of a scene to the definition of the estimator. @param bias  of the picture that must be found
testing::AssertionResult agrees(const Scene& scene, int spp, double bias = 0.08) {
  const test::Agreement a = test::agreement(scene, spp, 1);
  if (a.worst < test::kSigmas && a.detectable < bias) return testing::AssertionSuccess();
  return testing::AssertionFailure() << a.text() << "; allowed " << test::kSigmas << " and " << bias;
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
  // And what the lanes have no kernel for: lights with a place, droplets, colours. And glow.
  test::write_coloured_vdb(
      folder / "coloured.vdb", {ivec3(0), ivec3(15)}, [](const ivec3& v) { return 0.1f * static_cast<float>(v.z); },
      [](const ivec3& v) { return vec3(v) / 16.0f; });
  Scene other = scene;
  other.volumes[0].file = folder / "coloured.vdb";
  other.volumes[0].albedo_grid = "auto";
  other.volumes[0].object_to_world = dmat4(1);
  other.volumes[0].sigma_t = dvec3(0.3);
  other.volumes[0].phase = "mie";
  other.camera.position = {7.5, -40, 7.5}, other.camera.look_at = dvec3(7.5);
  other.lights.assign(1, {});
  other.lights[0].type = "sphere";
  other.lights[0].position = dvec3(7, 3, 9);
  other.lights[0].radius = 1;
  other.lights[0].radiance = dvec3(3);
  other.lights[0].visible_to_camera = true;
  other.volumes[0].emission = dvec3(0.1, 0.2, 0.3);
  int bundles = 0;
  for (const Scene& s : {scene, other}) {
    const PreparedScene prepared(s, LayerRequest::of({"all"}, true));
    ASSERT_TRUE(prepared.plan().one_grid);
    const auto starts = prepared.entry_bounds(Camera(s.camera, 40, 40, prepared.world_shift()), {0, 0, 40, 40});
    bundles += std::any_of(starts.begin(), starts.end(), [](const EntryBound& p) { return p.axis >= 0; });
    const Layers best = prepared.render(4, 1, {}).layers;
    const int seen = test::on_every_target(
        [&](const std::string& name) { test::expect_same_bits(best, prepared.render(4, 1, {}).layers, name); });
    EXPECT_GT(seen, 1);
  }
  EXPECT_EQ(bundles, 1) << "one scene's pixels are fine, the other's are coarse";
}

// Several media, chromatic ones, homogeneous shapes, meshes, lamps: whatever the lanes are and however many threads.
TEST(Wavefront, PathsInTheWorldHaveTheSameBitsEverywhere) {
  const test::TemporaryFolder folder;
  std::set<std::string> kinds;
  for (const uint64_t seed : {45, 65, 68, 2, 121, 135}) {
    const test::RandomScene random = test::random_scene(seed, folder.path(), 4);
    const PreparedScene prepared(random.scene, every_recorded_layer());
    ASSERT_FALSE(prepared.plan().one_grid) << seed;
    kinds.insert(random.kinds.begin(), random.kinds.end());
    const Layers best = prepared.render(4, 1, {}).layers;
    test::expect_same_bits(best, prepared.render(4, 1, {1, {}, nullptr}).layers, "one thread");
    test::on_every_target(
        [&](const std::string& name) { test::expect_same_bits(best, prepared.render(4, 1, {}).layers, name); });
  }
  for (const char* kind : {"overlapping", "chromatic", "box", "sphere", "grid", "emissive", "floor", "glass", "sun",
                           "spot", "velocities", "moving object"})
    EXPECT_TRUE(kinds.contains(kind)) << kind;
}

// Flights in lanes through one grid and flights in double precision in the world have one expectation, layer by layer.
// Over 48 x 48 pixels of 64 paths each, 4.5 standard errors of the light are below 4.5 %: such a bias of either would
// be found.
TEST(Wavefront, FlightsInDoublePrecisionAgree) {
  for (const std::string name : {"cloud", "smoke", "cloud of droplets", "smoke in two lobes"}) {
    Scene scene = demo(name.starts_with("cloud") ? "cloud" : "smoke", 48);
    VolumeSettings& volume = scene.volumes[0];
    if (name == "cloud of droplets") {
      volume.phase = "mie";
      volume.droplet_diameter = 8;
      scene.lights.clear();  // their sharp peak towards a sun is noise
      scene.environment.radiance = dvec3(1);
    }
    if (name == "smoke in two lobes") {
      volume.phase = "two_lobes";
      volume.lobe_weight = 0.4;
      volume.g = -0.3;
      volume.g2 = 0.7;
    }
    const auto render = [&](const char* majorants, int64_t seed) {
      scene.render.majorants = majorants;
      const PreparedScene prepared(scene, every_recorded_layer());
      EXPECT_EQ(prepared.plan().one_grid, std::string(majorants) == "cells");
      return prepared.render(64, seed, {}).layers;
    };
    const Layers a = render("cells", 1), b = render("global", 2);
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
      // lamp of the flash image is calibrated from a few thousand paths.
      const double error = 4.5 * std::sqrt(3 * variance);
      EXPECT_NEAR(sum_a, sum_b, error + (l.name == layer::flash ? 0.03 : 1e-3) * std::abs(sum_b))
          << name << " " << l.name.label();
      if (l.name == layer::indirect || l.name == layer::direct) {
        EXPECT_LT(error, 0.045 * sum_b) << name << " " << l.name.label();
      }
    }
  }
}

// Lights that stand somewhere: before the medium, inside it, behind it, seen or not, many or one, against the
// definition.
TEST(Wavefront, LocalLightsAreThoseOfTheDefinition) {
  const auto light = [](const char* type, const dvec3& position) {
    LightSettings l;
    l.type = type;
    l.position = position;
    return l;
  };
  LightSettings point = light("point", {0.1, -0.2, 1.2}), spot = light("spot", {-1.5, -1.5, 3});
  point.intensity = dvec3(3, 2, 1);
  spot.intensity = dvec3(20);
  spot.direction = {1, 1, -1.2};
  LightSettings sphere = light("sphere", {0.3, 0.1, 1.6}), small = light("sphere", {-0.2, -2, 1.3});
  sphere.radius = 0.15;
  sphere.radiance = dvec3(40, 30, 20);
  sphere.visible_to_camera = true;
  small.radius = 0.08;
  small.radiance = dvec3(60);
  small.visible_to_camera = false;
  LightSettings rectangle = light("rectangle", {-0.6, -1.2, 1});
  rectangle.edge_x = {0.5, 0, 0}, rectangle.edge_y = {0, -0.2, 0.6}, rectangle.radiance = dvec3(8, 9, 10);
  rectangle.two_sided = rectangle.visible_to_camera = true;
  LightSettings screen = light("rectangle", {0.5, -1.3, -1}), lamp = light("sphere", {0.1, -2, 1.3});
  screen.edge_x = {0, 0, 4}, screen.edge_y = {-2, 0, 0}, screen.radiance = dvec3(1);
  lamp.radius = 0.2;
  lamp.radiance = dvec3(100);
  LightSettings core = light("sphere", {0, 0, 1.5});
  core.radius = 0.5;
  core.radiance = dvec3(2);
  core.visible_to_camera = true;
  struct Case {
    const char* name;
    std::vector<LightSettings> lights;
    bool sun, sampled;
    const char* first_collision;
  };
  for (const Case& c :
       {Case{"points", {point, spot}, false, true, "free"}, Case{"a sphere inside", {sphere}, false, true, "forced"},
        Case{"a rectangle before", {rectangle}, false, true, "free"},
        Case{"everything", {point, sphere, small, rectangle, spot}, true, true, "forced"},
        Case{"one before another", {screen, lamp}, false, true, "free"}, Case{"a core", {core}, false, true, "forced"},
        Case{"not sampled", {sphere, rectangle}, false, false, "forced"}}) {
    Scene scene = demo("smoke", 32);
    if (!c.sun) {
      scene.lights.clear();
      scene.environment.radiance = dvec3(0);
    }
    scene.lights.insert(scene.lights.end(), c.lights.begin(), c.lights.end());
    if (!c.sampled) scene.render.light_sampling = "none";
    scene.volumes[0].sigma_t = dvec3(6);
    scene.render.first_collision = c.first_collision;
    EXPECT_TRUE(agrees(scene, 320, 0.12)) << c.name;
  }
}

// Towards a sharp peak, single precision must hold the angle, not its cosine.
TEST(Wavefront, SharpPeaksKeepTheirLight) {
  struct Case {
    const char* phase;
    double g, towards;
  };
  for (const Case& c : {Case{"henyey_greenstein", 0.999, 1}, Case{"henyey_greenstein", -0.999, -1},
                        Case{"two_lobes", 0.999, 1}, Case{"mie", 0, 1}}) {
    Scene scene = demo("smoke", 16);
    scene.camera.look_at = {0, 0, 1.5}, scene.camera.position = {0, -7, 1.5}, scene.camera.fov = 0.1;
    scene.environment.radiance = dvec3(0);
    scene.lights[0].direction = {0, c.towards, 0}, scene.lights[0].irradiance = dvec3(1);
    scene.lights[0].angular_diameter = 0;
    VolumeSettings& volume = scene.volumes[0];
    volume.phase = c.phase;
    volume.g = c.g;
    volume.g2 = 0.5;
    volume.lobe_weight = 0.3;
    volume.droplet_diameter = 50;
    volume.sigma_t = dvec3(c.phase == std::string("mie") ? 6 : 1);
    volume.albedo = dvec3(1);
    EXPECT_TRUE(agrees(scene, 2000, 0.1)) << c.phase;
  }
}

// A grid of one colour is an albedo: the same picture but for rounding. A grid of several: that of the
// definition.
TEST(Wavefront, ColourGridsAreAlbedo) {
  const test::TemporaryFolder folder;
  const VoxelBox box{ivec3(0), ivec3(15)};
  const auto density = [](const ivec3& v) { return 0.2f + 0.05f * static_cast<float>(v.z); };
  test::write_coloured_vdb(folder / "even.vdb", box, density, [](const ivec3&) { return vec3(0.5f, 1.0f, 0.25f); });
  test::write_coloured_vdb(folder / "striped.vdb", box, density,
                           [](const ivec3& v) { return v.x < 7 ? vec3(1.0f, 0.1f, 0.3f) : vec3(0.2f, 0.9f, 0.6f); });
  Scene scene = demo("smoke", 24);
  VolumeSettings& volume = scene.volumes[0];
  volume.grid = "density";
  volume.sigma_t = dvec3(0.4);
  volume.object_to_world = dmat4(1);
  scene.camera.position = {7.5, -40, 7.5}, scene.camera.look_at = dvec3(7.5);
  const auto render = [&](const char* file, const char* colour, const dvec3& albedo, const char* majorants) {
    volume.file = folder / file;
    volume.albedo_grid = colour;
    volume.albedo = albedo;
    scene.render.majorants = majorants;
    const PreparedScene prepared(scene, LayerRequest::of({"direct", "indirect"}, true));
    EXPECT_EQ(prepared.plan().one_grid, std::string(majorants) == "cells");
    return prepared.render(512, 1, {}).layers;
  };
  for (const char* majorants : {"cells", "global"}) {
    const Layers tinted = render("even.vdb", "auto", dvec3(0.8), majorants);
    const Layers plain = render("even.vdb", "none", dvec3(0.8) * dvec3(0.5, 1, 0.25), majorants);
    for (const char* channel : {"indirect.R", "indirect.G", "indirect.B"})
      for (int y = 0; y < 24; ++y)
        for (int x = 0; x < 24; ++x)
          ASSERT_NEAR(tinted.at(channel)(x, y), plain.at(channel)(x, y), 1e-4f * plain.at(channel)(x, y) + 1e-6f)
              << majorants << channel << x << "," << y;
  }
  volume.file = folder / "striped.vdb";
  volume.albedo_grid = "auto";
  volume.albedo = dvec3(0.8);
  EXPECT_TRUE(agrees(scene, 320));
}

// Forced first collisions change no mean, whatever the medium's depth; in a thin one they take most of the noise away.
TEST(Wavefront, ForcedFirstCollisionsChangeNoMean) {
  struct Case {
    const char* name;
    double sigma_t;
  };
  for (const Case& c : {Case{"cloud", 0}, Case{"smoke", 0}, Case{"smoke", 1.0}}) {
    Scene scene = demo(c.name, 40);
    if (c.sigma_t > 0) scene.volumes[0].sigma_t = dvec3(c.sigma_t);
    const auto render = [&](const char* setting, int64_t seed) {
      scene.render.first_collision = setting;
      const PreparedScene prepared(scene, every_recorded_layer());
      EXPECT_EQ(prepared.plan().first_collision.forced, std::string(setting) == "forced");
      return prepared.render(160, seed, {}).layers;
    };
    const Layers forced = render("forced", 1), free = render("free", 2);
    for (const RecordedLayer& l : recordable_layers())
      for (size_t k = 0; k < l.name.channels.size(); ++k) {
        double difference = 0, total = 0, variance_forced = 0, variance_free = 0;
        for (int y = 0; y < 40; ++y)
          for (int x = 0; x < 40; ++x) {
            difference += forced.at(l.name.channel(k))(x, y) - free.at(l.name.channel(k))(x, y);
            total += std::abs(free.at(l.name.channel(k))(x, y));
            variance_forced += forced.at(l.name.channel_of(statistic::mean_variance, k))(x, y);
            variance_free += free.at(l.name.channel_of(statistic::mean_variance, k))(x, y);
          }
        const double error = std::sqrt(variance_forced + variance_free);
        EXPECT_LE(std::abs(difference), 4.5 * error + (l.name == layer::flash ? 0.03 : 1e-4) * total)
            << c.name << " " << c.sigma_t << " " << l.name.channel(k);
        if (l.name == layer::indirect || l.name == layer::single) {
          EXPECT_LT(4.5 * error, 0.1 * total) << c.name;
        }
        if (c.sigma_t > 0 && (l.name == layer::direct || l.name == layer::scatter_share)) {
          EXPECT_LT(variance_forced, 0.5 * variance_free) << l.name.channel(k);
        }
      }
  }
}

// Without absorption and under an even sky, what passes and what is scattered add up to the sky in every path.
TEST(Wavefront, ForcedFirstCollisionsLoseNothing) {
  Scene scene = demo("smoke", 24);
  scene.volumes[0].albedo = dvec3(1);
  scene.lights.clear();
  scene.environment = {};
  scene.environment.radiance = dvec3(1);
  scene.render.first_collision = "forced";
  scene.render.roulette_start = scene.render.max_events;
  const Layers frame = PreparedScene(scene, every_recorded_layer()).render(16, 1, {}).layers;
  const Plane& beauty = frame.at("R");
  int checked = 0;
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 24; ++x) {
      if (frame.at("A")(x, y) < 0.02f) continue;  // there, roulette of the rest
      EXPECT_NEAR(beauty(x, y), 1, 2e-2) << x << "," << y;
      ++checked;
    }
  EXPECT_GT(checked, 50);
}

// A majorant that is looser costs look-ups and changes no mean (docs/methods.md, Closed forms): 5 standard errors are
// about 1 %.
TEST(Wavefront, MajorantsOfOneTwoAndFiveTimesGiveOneMean) {
  Scene scene = demo("cloud", 48);
  test::Mean first;
  uint64_t lookups = 0;
  for (const double scale : {1.0, 2.0, 5.0})
    for (const char* majorants : {"cells", "global"}) {
      scene.render.majorant_scale = scale;
      scene.render.majorants = majorants;
      const RenderResult r = PreparedScene(scene, {}).render(100, static_cast<int64_t>(scale), {});
      const test::Mean mean = test::mean_radiance(r.layers, layer::indirect);
      if (scale == 1 && std::string(majorants) == "cells") {
        first = mean;
      } else {
        EXPECT_NEAR(mean.value.x, first.value.x, 5 * std::hypot(mean.error.x, first.error.x))
            << scale << " " << majorants;
      }
      if (std::string(majorants) == "cells") {
        EXPECT_GT(r.report.counters.tracking.lookups, lookups);
        lookups = r.report.counters.tracking.lookups;
      }
    }
}

// Cells of half and double the size bound the same density: 5 standard errors are about 1 %.
TEST(Wavefront, CellsOfEverySizeGiveOneMean) {
  Scene scene = demo("cloud", 48);
  test::Mean first;
  for (const int size : {8, 2, 4, 16, 32}) {
    scene.render.cell_size = size;
    const Layers frame = PreparedScene(scene, {}).render(100, size, {}).layers;
    const test::Mean mean = test::mean_radiance(frame, layer::indirect);
    if (size == 8)
      first = mean;
    else
      EXPECT_NEAR(mean.value.x, first.value.x, 5 * std::hypot(mean.error.x, first.error.x)) << size;
  }
}

// Single precision in local coordinates, where one grid is all there is; the world for everything else.
TEST(Wavefront, KnowsWhereOneGridIsAllThereIs) {
  const auto one_grid = [](const std::function<void(Scene&)>& change) {
    Scene scene = demo("smoke", 16);
    change(scene);
    return PreparedScene(scene, {}).plan().one_grid;
  };
  EXPECT_TRUE(one_grid([](Scene&) {}));
  EXPECT_TRUE(one_grid([](Scene& s) { s.volumes[0].emission = dvec3(1); }));
  EXPECT_FALSE(one_grid([](Scene& s) { s.volumes[0].sigma_t = dvec3(1, 2, 3); }));
  EXPECT_FALSE(one_grid([](Scene& s) { s.volumes.push_back(s.volumes[0]); }));
  EXPECT_FALSE(one_grid([](Scene& s) { s.render.majorants = "global"; }));
}

}  // namespace
}  // namespace brume
