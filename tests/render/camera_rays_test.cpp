// What follows from camera rays alone, found in lanes and one by one.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "render/session/renderer.h"
#include "render/transport/camera_layers.h"
#include "render/transport/lane_scene.h"
#include "render/transport/wavefront.h"
#include "render/world/camera.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::demo;

/// Every layer that paths record, and none of those that guides compute.
LayerRequest every_recorded_layer() {
  LayerRequest layers = LayerRequest::of({"all"}, true);
  layers.guides = false;
  return layers;
}

// Walks for layers draw from copies of the paths' generators, and rays that meet nothing end early with the same light.
TEST(CameraRays, RecordedLayersChangeNoBitOfThePicture) {
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
TEST(CameraRays, CameraRaysRecordTheSameInDoublePrecision) {
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
TEST(CameraRays, MarchedDepthHasNoBias) {
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
TEST(CameraRays, RaysAlongAxesPassWhateverTheSignsOfTheirZeros) {
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
TEST(CameraRays, RaysInAllDirectionsMeetAllThatIsOnTheirWay) {
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
TEST(CameraRays, SamplesAreTheSameFromWhereTheirPixelStarts) {
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

}  // namespace
}  // namespace brume
