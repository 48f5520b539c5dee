// Detail below the voxel in scenes: every kind of flight against the definition of the estimator, pictures of it
// against those of a volume that holds it in voxels, guides, errors.

#include "volume/detail.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/reference_frame.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

constexpr VoxelBox kBox{ivec3(0), ivec3(23)};

/// A ball of waves, 24 voxels wide, that falls off towards its rim.
float ball(const ivec3& v) {
  const double r = glm::length(dvec3(v) - 11.5) / 11.5;
  const double waves = std::sin(0.9 * v.x) + std::sin(0.7 * v.y + 1) + std::sin(0.8 * v.z + 2);
  return static_cast<float>(std::max(0.0, std::min(1.0, 3 * (1 - r)) * (1 + 0.25 * waves)));
}

VolumeDetail detail(double amplitude, double frequency, int octaves) {
  return {.amplitude = amplitude, .frequency = frequency, .octaves = octaves, .seed = 3, .given = true};
}

/// The ball, in the light of a sun and a sky.
struct Lit {
  Lit() {
    test::write_affine_vdb(folder / "ball.vdb", kBox, dmat4(1), ball);
    scene.film.width = 32, scene.film.height = 24;
    scene.camera.position = dvec3(16, -40, 20), scene.camera.look_at = dvec3(11.5), scene.camera.fov = 34;
    scene.environment.radiance = dvec3(0.4, 0.45, 0.5);
    LightSettings sun;
    sun.type = "sun", sun.direction = dvec3(-0.8, -0.3, 0.5), sun.irradiance = dvec3(3, 2.5, 2);
    scene.lights.push_back(sun);
    VolumeSettings& v = scene.volumes.emplace_back();
    v.file = folder / "ball.vdb";
    v.sigma_t = dvec3(0.4), v.albedo = dvec3(0.85), v.g = 0.3;
    v.detail = detail(0.9, 0.6, 3);
  }
  void use_velocity(const dvec3& velocity) {
    test::write_velocity_vdb(folder / "flow.vdb", folder / "ball.vdb", {ivec3(-4), ivec3(28)}, velocity);
    scene.volumes[0].file = folder / "flow.vdb";
    scene.volumes[0].velocity_grid = "auto";
    scene.render.frame = 7;
  }
  test::TemporaryFolder folder;
  Scene scene;
};

void expect_agreement(const Scene& scene, const char* what) {
  const test::Agreement a = test::agreement(scene, 100, 1);
  EXPECT_LT(a.worst, test::kSigmas) << what << ": " << a.text();
  EXPECT_LT(a.detectable, 0.08) << what << ": " << a.text();
}

TEST(DetailAgainstTheDefinition, InEveryKindOfFlight) {
  const Lit lit;
  expect_agreement(lit.scene, "one grid");
  Scene s = lit.scene;
  s.volumes[0].sigma_t = dvec3(0.03);
  s.render.first_collision = "forced";
  expect_agreement(s, "forced first collisions");
  s = lit.scene;
  s.render.lookup = "interpolated";
  s.render.majorant_scale = 1.7;
  LightSettings lamp;
  lamp.type = "sphere", lamp.position = dvec3(2, -4, 24), lamp.radius = 2, lamp.radiance = dvec3(20);
  s.lights.push_back(lamp);
  expect_agreement(s, "interpolated, with a lamp");
  s = lit.scene;
  s.volumes[0].sigma_t = dvec3(0.5, 0.3, 0.2);
  expect_agreement(s, "chromatic");
  s = lit.scene;
  s.render.majorants = "global";
  expect_agreement(s, "double precision");
  s = lit.scene;
  s.volumes[0].emission = dvec3(0.02, 0.01, 0.01);
  expect_agreement(s, "emission");
}

TEST(DetailAgainstTheDefinition, InMotion) {
  Lit lit;
  lit.use_velocity(dvec3(1.5, 0.5, -1));
  expect_agreement(lit.scene, "carried along");
  lit.scene.camera.shutter = dvec2(-0.5, 0.5);
  expect_agreement(lit.scene, "carried along and blurred");
  Scene s = Lit().scene;
  s.camera.shutter = dvec2(-0.5, 0.5);
  const Lit still;
  s.volumes[0].file = still.scene.volumes[0].file;
  s.volumes[0].object_to_world_end = test::translation(dvec3(2, 0, 1));
  expect_agreement(s, "moved by a matrix");
}

TEST(DetailAgainstTheDefinition, InInstances) {
  const Lit lit;
  Scene s = lit.scene;
  auto list = std::make_shared<InstanceList>();
  Rng rng(7);
  for (int i = 0; i < 5; ++i) {
    list->matrices.push_back(test::translation(test::random_point(rng, dvec3(-9), dvec3(9))));
    list->densities.push_back(0.3 + rng.uniform());
    list->tints.push_back(dvec3(1));
  }
  InstanceSettings& instances = s.instances.emplace_back();
  instances.arrays = list;
  expect_agreement(s, "instances");
}

/// So dense that its flights cross cells of half the size.
Scene in_small_cells(const Lit& lit) {
  Scene s = lit.scene;
  s.volumes[0].sigma_t = dvec3(4);
  return s;
}

TEST(DetailAgainstTheDefinition, InSmallCells) {
  const Lit lit;
  Scene s = in_small_cells(lit);
  ASSERT_NE(PreparedScene(s, {}).context().displaced_grids[0].density.values, nullptr);
  ASSERT_EQ(PreparedScene(lit.scene, {}).context().displaced_grids[0].density.values, nullptr);
  expect_agreement(s, "one grid");
  s.render.lookup = "interpolated";
  LightSettings lamp;
  lamp.type = "sphere", lamp.position = dvec3(2, -4, 24), lamp.radius = 2, lamp.radiance = dvec3(20);
  s.lights.push_back(lamp);
  expect_agreement(s, "interpolated, with a lamp");
  s = in_small_cells(lit);
  s.volumes[0].sigma_t = dvec3(4, 3, 2.5);
  expect_agreement(s, "chromatic");
}

// Cells of noise are 5 voxels of the finer lattice wide or more, which is linear between voxels: it misses up to 2 % of
// the density there. Seen from near, where a pixel is a quarter of a voxel.
TEST(DetailInScenes, LooksAsAVolumeThatHoldsItInVoxels) {
  Lit lit;
  lit.scene.volumes[0].detail = detail(1, 0.4, 2);
  lit.scene.volumes[0].sigma_t = dvec3(0.8);
  lit.scene.camera.position = dvec3(11.5, -20, 14);
  lit.scene.camera.look_at = dvec3(10, 11.5, 14);
  lit.scene.camera.fov = 14;
  const BrickGrid bricks = test::make_bricks(kBox, ball);
  const Detail noise({1, 0.4, 2, 3}, bricks.origin());
  dmat4 quarter(dmat3(0.25));
  test::write_affine_vdb(lit.folder / "baked.vdb", {ivec3(-4), ivec3(4 * 24)}, quarter, [&](const ivec3& v) {
    const dvec3 local = 0.25 * dvec3(v) - dvec3(bricks.origin());
    return static_cast<float>(bricks.lookup(local) * noise.factor(local));
  });
  const auto rendered = [](const Scene& s) { return PreparedScene(s, {}).render(600, 1, {}).layers; };
  Scene s = lit.scene;
  const Layers fine = rendered(s);
  s.volumes[0].detail = {};
  const Layers smooth = rendered(s);
  s.volumes[0].file = lit.folder / "baked.vdb";
  const Layers baked = rendered(s);
  // Of means of 2 x 2 pixels, relative to the picture's mean, the noise left out.
  const auto difference = [&](const Layers& a) {
    double squares = 0, light = 0;
    int count = 0;
    for (int y = 0; y < a.height(); y += 2)
      for (int x = 0; x < a.width(); x += 2, ++count) {
        double d = 0, noise_of_both = 0;
        for (int k = 0; k < 4; ++k) {
          const int px = x + k % 2, py = y + k / 2;
          d += (*a.rgb(layer::beauty)[1])(px, py) - (*baked.rgb(layer::beauty)[1])(px, py);
          light += (*baked.rgb(layer::beauty)[1])(px, py);
          for (const Layers* of : {&a, &baked})
            noise_of_both += (*of->rgb(layer::beauty, statistic::mean_variance)[1])(px, py);
        }
        squares += d * d - noise_of_both;
      }
    return std::sqrt(std::max(0.0, squares / count)) / (light / count);
  };
  const test::Mean a = test::mean_radiance(fine), b = test::mean_radiance(baked);
  EXPECT_NEAR(a.value.y / b.value.y, 1, 0.005 + 4.5 * std::hypot(a.error.y, b.error.y) / b.value.y);
  EXPECT_LT(difference(fine), 0.02);
  EXPECT_GT(difference(smooth), 0.08);
}

TEST(DetailInScenes, IsSeenByTheOpacityOfGuides) {
  Lit lit;
  Scene& s = lit.scene;
  s.volumes[0].detail = detail(1, 0.5, 3);
  s.volumes[0].sigma_t = dvec3(0.12), s.volumes[0].albedo = dvec3(0);
  s.camera.position = dvec3(11.5, -20, 14), s.camera.look_at = dvec3(7, 11.5, 14), s.camera.fov = 14;
  const Layers truth = PreparedScene(s, {}).render(5000, 1, {}).layers;  // noise of 0.005
  const auto error = [&](const Scene& guided) {
    const Layers guides = PreparedScene(guided, LayerRequest::of({"guides"}, false)).render(1, 1, {}).layers;
    double squares = 0;
    for (int y = 0; y < truth.height(); ++y)
      for (int x = 0; x < truth.width(); ++x) {
        const double d = guides.at("guide.opacity.Y")(x, y) - truth.at("A")(x, y);
        squares += d * d;
      }
    return std::sqrt(squares / (truth.width() * truth.height()));
  };
  Scene smooth = s;
  smooth.volumes[0].detail = {};
  const double of_smooth = error(smooth);
  EXPECT_GT(of_smooth, 0.05);
  // Side by side, and point by point next to a faint medium in a layer.
  EXPECT_LT(error(s), 0.2 * of_smooth);
  Scene two = s;
  VolumeSettings& layer = two.volumes.emplace_back();
  layer.shape = "layer", layer.lo = dvec3(-5), layer.hi = dvec3(30), layer.sigma_t = dvec3(1e-9);
  layer.scale_height = 10;
  EXPECT_LT(error(two), 0.2 * of_smooth);
}

TEST(DetailInScenes, HasTheSameBitsWhateverTheLanes) {
  Lit carried;
  carried.use_velocity(dvec3(1.5, 0.5, -1));
  Scene blurred = carried.scene;
  blurred.camera.shutter = dvec2(0, 0.5);
  const Lit lit;
  for (const Scene& scene : {lit.scene, in_small_cells(lit), carried.scene, blurred}) {
    const PreparedScene prepared(scene, LayerRequest::of({"direct", "indirect", "optical_depth", "guides"}, true));
    const Layers best = prepared.render(4, 1, {}).layers;
    test::expect_same_bits(best, prepared.render(4, 1, {1, {}, nullptr}).layers, "one thread");
    test::on_every_target(
        [&](const std::string& name) { test::expect_same_bits(best, prepared.render(4, 1, {}).layers, name); });
  }
}

TEST(DetailInScenes, NoneHasTheBitsOfNone) {
  const Lit lit;
  Scene s = lit.scene;
  s.volumes[0].detail.amplitude = 0;
  const Layers none = PreparedScene(s, {}).render(4, 1, {}).layers;
  s.volumes[0].detail = {};
  test::expect_same_bits(none, PreparedScene(s, {}).render(4, 1, {}).layers);
}

TEST(DetailInScenes, WrongTablesAreRefused) {
  const Lit lit;
  const auto parsed = [&](const std::string& keys, const std::vector<std::string>& assignments = {}) {
    return parse_scene("[camera]\nposition = [0, 0, 0]\nlook_at = [0, 1, 0]\n[[volumes]]\n" + keys,
                       lit.folder / "scene.toml", assignments);
  };
  const auto expect = [&](const std::string& keys, const std::string& part) {
    const std::string error = test::error_of([&] { parsed(keys); });
    EXPECT_NE(error.find(part), std::string::npos) << keys << error;
    EXPECT_NE(error.find("scene.toml"), std::string::npos) << error;
  };
  const std::string file = "file = \"ball.vdb\"\n";
  expect(file + "detail = 3\n", "'detail'");
  expect(file + "detail = { amplitud = 0.5 }\n", "did you mean 'amplitude'");
  expect(file + "detail = { amplitude = 1.5 }\n", "'amplitude' is out of range");
  expect(file + "detail = { frequency = 0 }\n", "'frequency' is out of range");
  expect(file + "detail = { octaves = 9 }\n", "'octaves' is out of range");
  expect(file + "detail = { octaves = 2.5 }\n", "expected an integer");
  expect("shape = \"box\"\ndetail = { amplitude = 0.5 }\n", "'detail' stands beside shape = \"box\"");

  const Scene plain = parsed(file), with = parsed(file + "[volumes.detail]\nseed = 4\n"),
              assigned = parsed(file, {"volumes.0.detail.seed=4"});
  EXPECT_FALSE(plain.volumes[0].detail.given);
  EXPECT_TRUE(with.volumes[0].detail.given);
  EXPECT_EQ(assigned.volumes[0].detail.seed, 4);
  EXPECT_NE(plain.hash, with.hash);
  EXPECT_EQ(assigned.hash, with.hash);
}

}  // namespace
}  // namespace brume
