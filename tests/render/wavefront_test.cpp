#include "render/transport/wavefront.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <string>

#include "image/exr_io.h"
#include "render/session/renderer.h"
#include "render/transport/camera_layers.h"
#include "render/transport/lane_scene.h"
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

// Walks for layers draw from copies of the paths' generators, and rays that meet nothing end early with the same light.
TEST(Wavefront, RecordedLayersChangeNoBitOfThePicture) {
  for (const double sigma_t : {18.0, 1.0}) {
    Scene scene = demo("smoke", 40);
    scene.volumes[0].sigma_t = dvec3(sigma_t);
    const Layers bare = PreparedScene(scene, LayerRequest{{}, false}).render(4, 1, {}).layers;
    const Layers all = PreparedScene(scene, every_recorded_layer()).render(4, 1, {}).layers;
    for (const char* channel : {"R", "G", "B", "A"})
      for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 40; ++x)
          ASSERT_EQ(bare.at(channel)(x, y), all.at(channel)(x, y)) << channel << x << "," << y;
  }
}

// What follows from the camera rays alone is found in lanes and in double precision for the same rays, marched with
// other steps: coverage but for one wisp in two hundred, directions to a fiftieth, optical depths, whose expectation is
// known for each ray, to 4.5 standard errors of the mean over the picture (below 1.5 %).
TEST(Wavefront, CameraRaysRecordTheSameInDoublePrecision) {
  for (const char* name : {"cloud", "smoke"}) {
    Scene scene = demo(name, 32);
    const auto render = [&](const char* majorants) {
      scene.render.majorants = majorants;
      return PreparedScene(scene, every_recorded_layer()).render(8, 1, {}).layers;
    };
    const Layers a = render("cells"), b = render("global");
    const auto sum = [&](const std::string& channel, auto&& of) {
      double total = 0;
      for (int y = 0; y < 32; ++y)
        for (int x = 0; x < 32; ++x) total += of(a.at(channel)(x, y), b.at(channel)(x, y));
      return total;
    };
    const auto difference = [](float p, float q) { return static_cast<double>(std::abs(p - q)); };
    const double covered = sum("coverage.A", [](float, float q) { return static_cast<double>(q); });
    ASSERT_GT(covered, 100);
    EXPECT_LT(sum("coverage.A", difference), 0.005 * covered) << name;
    for (const char axis : {'X', 'Y', 'Z'})
      EXPECT_LT(sum(std::string("gradient.") + axis, difference), 0.02 * covered) << name << axis;
    const Camera camera(scene.camera, 32, 32, dvec3(0));
    const double mean = sum("optical_depth.Y", [](float p, float) { return static_cast<double>(p); });
    EXPECT_NEAR(
        mean, sum("optical_depth.Y", [](float, float q) { return static_cast<double>(q); }),
        4.5 * std::sqrt(sum("optical_depth.mean_variance.Y", [](float p, float q) { return p + q; })) + 0.002 * mean)
        << name;
  }
}

// One look-up per voxel length, of one voxel: without bias, ray by ray, against quadrature that is exact. A bias
// of 0.3 % would be found.
TEST(Wavefront, MarchedDepthHasNoBias) {
  Scene scene = demo("smoke", 8);
  for (const char* majorants : {"cells", "global"}) {
    scene.render.majorants = majorants;
    const PreparedScene prepared(scene, LayerRequest::of({"optical_depth"}, true));
    const Medium& medium = *prepared.medium();
    const Camera camera(scene.camera, 8, 8, prepared.world_shift());
    double exact = 0, marched = 0, variance = 0;
    constexpr int kDraws = 400;
    const Layers frame = prepared.render(kDraws, 1, {}).layers;
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 8; ++x) {
        marched += frame.at("optical_depth.Y")(x, y);
        variance += frame.at("optical_depth.mean_variance.Y")(x, y);
        for (uint32_t s = 0; s < kDraws; ++s)
          exact += std::min(50.0, optical_depth(medium, medium.to_local(prepared.request(camera, 1, x, y, s).ray),
                                                std::numeric_limits<double>::infinity())) /
                   kDraws;
      }
    // The rays are the same ones, so that only the march's own noise is left: far less than the variance over rays.
    EXPECT_NEAR(marched, exact, 0.003 * exact) << majorants;
    EXPECT_GT(variance, 0);
  }
}

// The grid of a LaneScene, for kernels alone.
LaneScene lane_scene_of(const LaneGrid& grid, float sigma) {
  LaneScene scene{};
  set_cells(scene, grid);
  scene.sigma = sigma;
  return scene;
}

struct MarchedRays {
  std::unique_ptr<PathStates> pool = std::make_unique<PathStates>();
  std::unique_ptr<CameraRayLayers> camera = std::make_unique<CameraRayLayers>();
  SlotList rays;

  void add(const vec3& o, const vec3& d) {
    const size_t s = rays.count;
    pool->flight.o.set(s, o);
    pool->flight.d.set(s, d);
    pool->generator[0][s] = static_cast<uint32_t>(s + 1);
    rays.push(s);
  }
};

// A direction of -0 never reaches a plane across its axis, no more than one of +0.
TEST(Wavefront, RaysAlongAxesPassWhateverTheSignsOfTheirZeros) {
  const BrickGrid bricks = test::constant_box(ivec3(0), ivec3(20));
  const LaneGrid grid(bricks);
  MarchedRays marched;
  const vec3 middle(bricks.support_lo() + 0.5 * (bricks.support_hi() - bricks.support_lo()));
  for (int k = 0; k < 24; ++k) {
    vec3 d, o = middle;
    for (int a = 0; a < 3; ++a) d[a] = k >> a & 1 ? -0.0f : 0.0f;
    const int axis = k / 8;
    d[axis] = k >> axis & 1 ? -1.0f : 1.0f;
    o[axis] -= 11.0f * d[axis];
    marched.add(o, d);
  }
  lanes_march(lane_scene_of(grid, 0.25f), *marched.pool, marched.rays, *marched.camera);
  for (size_t s = 0; s < 24; ++s)
    EXPECT_NEAR(marched.camera->depth[s], 0.25 * 21, 0.25) << s;  // the ends are one voxel's luck
}

// From anywhere in any direction, past empty cubes of all sizes: no ray misses a blob of 16 voxels or finds one twice.
TEST(Wavefront, RaysInAllDirectionsMeetAllThatIsOnTheirWay) {
  constexpr float kSigma = 0.05f;
  for (const int cell_size : {4, 8}) {
    const BrickGrid bricks =
        test::make_bricks({ivec3(0), ivec3(127)}, [](const ivec3& v) {
          Rng rng(hash_combine(static_cast<uint64_t>((v.x >> 4) * 8 + (v.y >> 4)), static_cast<uint64_t>(v.z >> 4)));
          return rng.uniform() < 0.1 ? 1.0f : 0.0f;
        }).recut(cell_size);
    const LaneGrid grid(bricks);
    const dvec3 size(bricks.cells() * cell_size);
    MarchedRays marched;
    Rng rng(5);
    for (int k = 0; k < 2000; ++k)
      marched.add(vec3(test::random_point(rng, dvec3(0), size)), vec3(test::random_direction(rng)));
    lanes_march(lane_scene_of(grid, kSigma), *marched.pool, marched.rays, *marched.camera);
    int hit = 0;
    for (size_t s = 0; s < 2000; ++s) {
      const PathStates& p = *marched.pool;
      const Ray ray{dvec3(p.flight.o[s]), dvec3(p.flight.d[s])};
      double depth = 0;
      for (double t = 0.05; t < glm::length(size); t += 0.1) depth += 0.1 * kSigma * bricks.lookup(ray.at(t));
      hit += depth > 0.5;
      ASSERT_NEAR(marched.camera->depth[s], depth, 0.4)
          << ray.o.x << " " << ray.o.y << " " << ray.o.z << ", " << ray.d.x << " " << ray.d.y << " " << ray.d.z;
    }
    EXPECT_GT(hit, 500);
  }
}

// A pixel's start takes away nothing but empty space: its samples are those of rays that walk all the way, for cameras
// of every kind and volumes turned and stretched. Where cells begin is rounded, so that one sample in a thousand
// differs.
TEST(Wavefront, SamplesAreTheSameFromWhereTheirPixelStarts) {
  struct Case {
    const char* type;
    double lens_radius, fov;
    const char* first_collision;
  };
  for (const Case& c : {Case{"perspective", 0, 26.5, "forced"}, Case{"perspective", 0, 60, "free"},
                        Case{"perspective", 0.2, 26.5, "forced"}, Case{"orthographic", 0, 0, "free"}}) {
    Scene scene = demo("smoke", 48);
    scene.camera.type = c.type;
    scene.camera.lens_radius = c.lens_radius;
    scene.camera.width = 4;
    if (c.fov > 0) scene.camera.fov = c.fov;
    scene.render.first_collision = c.first_collision;
    scene.volumes[0].object_to_world =
        scene.volumes[0].object_to_world * dmat4(1.1, 0.3, -0.2, 0, -0.2, 0.9, 0.1, 0, 0.3, 0.1, 1.3, 0, 0, 0, 0, 1);
    const PreparedScene prepared(scene, LayerRequest::of({"coverage", "gradient"}, true));
    ASSERT_TRUE(prepared.plan().one_grid);
    const Camera camera(scene.camera, 48, 48, prepared.world_shift());
    std::vector<PathRequest> all_the_way, started;
    const std::vector<EntryBound> starts = prepared.entry_bounds(camera, {0, 0, 48, 48});
    int skipped = 0;
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 48; ++x) {
        const EntryBound start = starts[static_cast<size_t>(y * 48 + x)];
        skipped += start.medium > 0.5f;
        for (uint32_t k = 0; k < 4; ++k) {
          all_the_way.push_back(prepared.request(camera, 1, x, y, k));
          started.push_back(prepared.request(camera, 1, x, y, k, start));
        }
      }
    EXPECT_EQ(skipped, 48 * 48);
    const auto trace = [&](const std::vector<PathRequest>& requests) {
      std::vector<PathSample> samples(requests.size());
      PathCounters counters;
      trace_paths(
          prepared.context(), requests, [&](size_t i, const PathSample& s) { samples[i] = s; }, counters);
      return samples;
    };
    const std::vector<PathSample> a = trace(all_the_way), b = trace(started);
    int other_light = 0, other_surface = 0;
    double covered = 0, gained = 0;
    for (size_t i = 0; i < a.size(); ++i) {
      other_light += glm::distance(a[i].beauty, b[i].beauty) > 1e-3;
      other_surface += a[i].coverage != b[i].coverage || glm::distance(a[i].gradient, b[i].gradient) > 0.3;
      covered += a[i].coverage;
      gained += b[i].coverage - a[i].coverage;
    }
    EXPECT_GT(covered, 400) << c.type << c.fov;
    EXPECT_LE(other_light, 0.002 * covered) << c.type << c.fov;
    EXPECT_LE(other_surface, 0.05 * covered) << c.type << c.fov;
    EXPECT_LT(std::abs(gained), 0.005 * covered) << c.type << c.fov;
  }
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

// Black bodies and ramps, with a lamp in the flames and without, emission far beyond the smoke, in grey and in
// chromatic smoke, against the definition.
TEST(Wavefront, EmissionIsThatOfTheDefinition) {
  const auto fire = [](const std::function<void(Scene&)>& change) {
    Scene scene = demo("fire", 32);
    scene.surfaces.clear();
    scene.film.height = 32;
    change(scene);
    return scene;
  };
  LightSettings lamp;
  lamp.type = "sphere", lamp.position = {0.2, 0, 0.6}, lamp.radius = 0.2, lamp.radiance = dvec3(3);
  lamp.visible_to_camera = true;
  const std::pair<const char*, Scene> cases[] = {
      {"black body", fire([](Scene& s) { s.lights.clear(); })},
      {"with a lamp inside", fire([&](Scene& s) {
         s.lights.push_back(lamp);
         s.volumes[0].emission = dvec3(2, 1, 0);
       })},
      {"beyond the smoke", fire([](Scene& s) {
         VolumeSettings& v = s.volumes[0];
         v.grid = "flame";
         v.flame_grid = "density";
         v.flame_intensity = 3;
         s.environment.radiance = dvec3(0.5);
       })},
      {"a ramp of many stops", fire([](Scene& s) {
         VolumeSettings& v = s.volumes[0];
         v.temperature_grid = "none";
         v.flame_grid = "flame";
         for (int i = 0; i < 70; ++i) v.flame_ramp.push_back({i / 70.0, i % 3 * 1.0, i / 50.0, i / 100.0});
       })}};
  for (const auto& [name, chosen] : cases) {
    Scene scene = chosen;
    EXPECT_TRUE(agrees(scene, 160, 0.1)) << name;
    const dvec3 sigma_t = scene.volumes[0].sigma_t;
    scene.volumes[0].sigma_t = sigma_t * dvec3(1, 0.6, 0.3);
    EXPECT_TRUE(agrees(scene, 160, 0.1)) << name << ", chromatic";
  }
}

// Fire as a light: of floors and smoke that lie far from it, beside a lamp, in colours, from behind clear glass, of a
// grid and of a shape; against the definition, which finds fire by directions alone.
TEST(Wavefront, FireLightsWhatIsFarFromIt) {
  const auto scene_of = [](const std::function<void(Scene&)>& change) {
    Scene s = demo("fire", 16);  // its floor, without its ball
    s.film.height = 16;
    s.camera.look_at = {0.3, 0, 0.5};
    s.lights.clear();
    s.surfaces.resize(1);
    VolumeSettings& fire = s.volumes[0];
    fire.object_to_world = test::translation({-0.8, 0, 0.2});
    for (int a = 0; a < 3; ++a) fire.object_to_world[a][a] = 0.5;
    VolumeSettings smoke;
    smoke.shape = "sphere";
    smoke.lo = {0.7, -0.6, 0.3}, smoke.hi = {1.7, 0.4, 1.3};
    smoke.sigma_t = dvec3(1.5);
    smoke.albedo = dvec3(0.8);
    smoke.g = 0.5;
    s.volumes.push_back(smoke);
    change(s);
    return s;
  };
  LightSettings lamp;
  lamp.type = "sphere", lamp.position = {1, -1, 2}, lamp.radius = 0.2, lamp.radiance = dvec3(3);
  const std::pair<const char*, Scene> cases[] = {
      {"flames", scene_of([](Scene&) {})},
      {"beside a lamp", scene_of([&](Scene& s) { s.lights.push_back(lamp); })},
      {"colours", scene_of([](Scene& s) { s.volumes[1].sigma_t = dvec3(2, 1.2, 0.6); })},
      {"a glowing ball", scene_of([](Scene& s) {
         VolumeSettings& ball = s.volumes[0];
         ball = s.volumes[1];
         ball.lo = dvec3(-0.5), ball.hi = dvec3(0.5);
         ball.object_to_world = test::translation({-0.6, 0, 0.6});
         ball.object_to_world[0][0] = 0.3;
         ball.emission = dvec3(20, 10, 3);
       })},
      {"no smoke", scene_of([](Scene& s) { s.volumes.resize(1); })}};
  for (const auto& [name, scene] : cases) {
    const PreparedScene prepared(scene, {});
    ASSERT_NE(prepared.lights().field(0), nullptr) << name;
    EXPECT_TRUE(agrees(scene, 1500, 0.1)) << name;
  }
  // Straight through clear glass light samples alone find it, which makes it direct light; the sum stays.
  Scene behind_glass = cases[0].second;
  SurfaceSettings glass = behind_glass.surfaces[0];
  glass.file = test::source("data/meshes/ball.obj");
  glass.material = "dielectric", glass.albedo = dvec3(1), glass.ior = 1.0001, glass.roughness = 0,
  glass.shadow = "straight";
  glass.object_to_world = test::translation({-0.1, 0, 0.5});
  for (int a = 0; a < 3; ++a) glass.object_to_world[a][a] = 0.4;
  behind_glass.surfaces.push_back(glass);
  const auto mean = [&](const char* sampling) {
    behind_glass.render.light_sampling = sampling;
    return test::mean_radiance(PreparedScene(behind_glass, {}).render(3000, 1).layers, layer::beauty);
  };
  const test::Mean points = mean("auto"), directions = mean("none");
  const double error = std::hypot(points.error.x, directions.error.x);
  EXPECT_NEAR(points.value.x, directions.value.x, 5 * error);
  EXPECT_LT(error, 0.01 * directions.value.x);
}

// A floor under a small flame. Directions seldom find it: they leave 2.5 times the floor's light as noise after 64
// samples; points leave 1 %.
TEST(Wavefront, SmallFlamesLightFloorsWithLittleNoise) {
  Scene scene = demo("fire", 8);
  scene.film.height = 8;
  scene.lights.clear();
  scene.environment.radiance = dvec3(0);
  scene.surfaces.resize(1);
  VolumeSettings flame;
  flame.shape = "box";
  flame.lo = {0.45, -0.05, 0.95}, flame.hi = {0.55, 0.05, 1.05};
  flame.sigma_t = dvec3(1e-6), flame.albedo = dvec3(0), flame.emission = dvec3(1000);
  scene.volumes = {flame};
  scene.camera.type = "orthographic";
  scene.camera.width = 0.02;
  scene.camera.position = {0, -0.01, 5}, scene.camera.look_at = dvec3(0);
  const Layers frame = PreparedScene(scene, LayerRequest::of({"surface"}, true)).render(64, 1).layers;
  // Each point is at (0.5, 0, 1) on average: radiance albedo / pi * cos / r^2 of an intensity of 1000 / 1000.
  const double expected = scene.surfaces[0].albedo.x / kPi / std::pow(1.25, 1.5);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) EXPECT_NEAR(frame.at("surface.R")(x, y), expected, 0.06 * expected) << x << ' ' << y;
}

// Along a camera ray what flames send through their smoke needs no chance: against a sum over ten thousand steps, and
// all samples of a pixel that one ray passes through are nearly alike. A bias of .2 % would be found.
TEST(Wavefront, CameraRaysSeeFlamesThroughSmokeWithoutNoise) {
  Scene scene = demo("fire", 8);
  scene.surfaces.clear();
  scene.lights.clear();
  scene.environment.radiance = dvec3(0);
  scene.volumes[0].albedo = dvec3(0);
  scene.volumes[0].sigma_t = dvec3(40);
  scene.camera.type = "orthographic";
  scene.camera.width = 1e-6;
  const SceneMedia media(scene, {});
  for (const double x : {-0.2, 0.0, 0.15}) {
    scene.camera.position = {x, -5, 0.5};
    scene.camera.look_at = {x, 0, 0.5};
    const PreparedScene prepared(scene, LayerRequest::of({"emission"}, true));
    ASSERT_TRUE(prepared.plan().seen_emission);
    const Layers frame = prepared.render(64, 1).layers;
    const Medium& smoke = media.media()[0];
    const EmissionField& flame = media.emissions()[0];
    constexpr int kSteps = 10000;
    double expected = 0, depth = 0;
    const double step = 10.0 / kSteps;
    for (int k = 0; k < kSteps; ++k) {
      const dvec3 at = dvec3(x, -5 + step * (k + 0.5), 0.5) - media.world_shift();
      const double thickness = step * smoke.extinction_per_density() * smoke.density(smoke.to_local(at));
      expected += step * flame.coefficient(at).x * std::exp(-depth - 0.5 * thickness);
      depth += thickness;
    }
    ASSERT_GT(expected, 0);
    double mean = 0, variance = 0;
    for (int y = 0; y < frame.height(); ++y)
      for (int c = 0; c < frame.width(); ++c) {
        mean += frame.at("emission.R")(c, y) / (8.0 * frame.height());
        variance += 64 * frame.at("emission.mean_variance.R")(c, y) / (8.0 * frame.height());
      }
    EXPECT_NEAR(mean, expected, 2e-3 * expected) << x;
    EXPECT_LT(std::sqrt(variance), 0.1 * expected) << x;  // of one sample; a random collision would leave more than 1
  }
}

// So they do through several media, homogeneous ones and chromatic ones among them: without noise the layer is what
// flights find in the mean.
TEST(Wavefront, CameraRaysSeeFlamesThroughAllMedia) {
  Scene scene = demo("fire", 16);
  scene.surfaces.clear();
  scene.lights.clear();
  VolumeSettings smoke = scene.volumes[0], haze;
  smoke.temperature_grid = "none";
  smoke.sigma_t = dvec3(5);
  smoke.object_to_world = test::translation({0.2, -0.5, 0.1}) * smoke.object_to_world;
  haze.shape = "sphere";
  haze.lo = {-0.4, -1.5, 0.2}, haze.hi = {0.6, 0.5, 1.2};
  haze.sigma_t = dvec3(1);
  scene.volumes.push_back(smoke);
  scene.volumes.push_back(haze);
  for (const dvec3& colour : {dvec3(1), dvec3(1, 0.6, 0.3)}) {
    for (VolumeSettings& v : scene.volumes) v.sigma_t *= colour;
    ASSERT_TRUE(PreparedScene(scene, {}).plan().seen_emission);
    EXPECT_TRUE(agrees(scene, 400)) << colour.y;
  }
}

// Equilibrium furnace: smoke that glows as much as it absorbs from a sky of 1 shows 1 in every pixel. 5 standard errors
// of the mean are below 0.3 %; those of each pixel cover it, and three scatterings that the pixel may lack by chance.
TEST(Wavefront, InBalanceWithTheSkyIsInvisible) {
  Scene scene = demo("smoke", 32);
  scene.lights.clear();
  scene.environment.radiance = dvec3(1);
  VolumeSettings& v = scene.volumes[0];
  v.albedo = dvec3(0.6);
  v.emission = v.sigma_t * (dvec3(1) - v.albedo);
  const PreparedScene prepared(scene, {});
  ASSERT_TRUE(prepared.plan().one_grid);
  const Layers frame = prepared.render(1024, 1, {}).layers;
  const test::Mean m = test::mean_radiance(frame);
  EXPECT_NEAR(m.value.x, 1, 5 * m.error.x);
  EXPECT_LT(5 * m.error.x, 0.003);
  int far = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x)
      far += std::abs(frame.at("R")(x, y) - 1) > 5 * std::sqrt(frame.at("mean_variance.R")(x, y)) + 3.0 / 1024;
  EXPECT_LE(far, 1);
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
