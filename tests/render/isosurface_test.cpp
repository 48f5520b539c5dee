#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "render/session/renderer.h"
#include "render/transport/wavefront.h"
#include "render/world/camera.h"
#include "tests/support/files.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"
#include "volume/gradient.h"

// The layers `coverage` and `gradient`.

namespace brume {
namespace {

struct Found {
  double rays = 0, together = 0;  // how many are walked with the others of their pixel
  double covered = 0;             // by rays that are marched in twentieths of a voxel
  double other = 0, turned = 0;   // rays that find another answer; by how much the gradients of the others differ
  double wrong =
      0;  // of those with another answer, who find what is not there or pass what is thicker than their steps
};

/// Two rays of every step-th pixel, against fine steps; and again alone, or with others than before.
Found against_fine_steps(const Scene& scene, int begin, int step) {
  const PreparedScene prepared(scene, LayerRequest::of({"gradient", "coverage"}, false));
  EXPECT_TRUE(prepared.plan().one_grid);
  const Medium& medium = *prepared.medium();
  const double iso = scene.render.surface_density * medium.maximum_density();
  const int size = scene.film.width;
  const Camera camera(scene.camera, size, size, prepared.world_shift());
  const std::vector<EntryBound> starts = prepared.entry_bounds(camera, {0, 0, size, size});
  std::vector<PathRequest> requests;
  Found found;
  for (int y = begin; y < size - begin; y += step)
    for (int x = begin; x < size - begin; x += step)
      for (uint32_t sample = 0; sample < 2; ++sample) {
        requests.push_back(prepared.request(camera, 0, x, y, sample, starts[static_cast<size_t>(y * size + x)]));
        found.together += requests.back().start.axis >= 0;
      }
  found.rays = static_cast<double>(requests.size());
  const auto trace = [&](std::span<const PathRequest> some, PathSample* samples) {
    PathCounters counters;
    trace_paths(
        prepared.context(), some, [&](size_t i, const PathSample& s) { samples[i] = s; }, counters);
  };
  std::vector<PathSample> samples(requests.size());
  trace(requests, samples.data());
  for (size_t i = 0; i < requests.size(); ++i) {
    PathSample alone;
    trace({&requests[i], 1}, &alone);
    EXPECT_EQ(alone.coverage, samples[i].coverage);
    EXPECT_EQ(alone.gradient, samples[i].gradient) << "whatever is walked with a ray";
    const Ray ray = medium.to_local(requests[i].ray);
    const auto [t0, t1] =
        HomogeneousShape{HomogeneousShape::Shape::kBox, medium.support().first, medium.support().second}.intersect(ray);
    const double voxel = 1 / glm::length(ray.d), start = std::max(t0, 0.0);
    double t = start;
    while (t < t1 && medium.density(ray.at(t)) < iso) t += 0.05 * voxel;
    const bool meets = t < t1;
    for (double back = 0.05 * voxel; meets && t > start && back > 1e-3 * voxel; back /= 2)
      if (medium.density(ray.at(t - back / 2)) >= iso) t -= back / 2;
    found.covered += meets;
    if (meets != (samples[i].coverage > 0)) {
      ++found.other;
      double most = 0, end = t;
      if (meets)
        while (medium.density(ray.at(end)) >= iso) end += 0.01 * voxel;
      else
        for (double s = start; s < t1; s += 0.001 * voxel) most = std::max(most, medium.density(ray.at(s)));
      const dvec3 across = (end - t) * glm::abs(ray.d);
      const bool together = requests[i].start.axis >= 0;
      const double layers = std::max({across.x, across.y, across.z}), voxels = glm::length(across);
      found.wrong += meets ? (together ? layers > 0.52 : voxels > 1.02) : most < (1 - 1e-4) * iso;
    }
    if (!meets || samples[i].coverage == 0) continue;
    const auto g = density_gradient(medium, ray.at(t + 0.5 * voxel));
    found.turned += glm::distance(g ? glm::normalize(*g) : dvec3(0), samples[i].gradient);
  }
  return found;
}

struct View {
  dvec3 position;
  double fov = 26.5;
  const char* type = "perspective";
  double lens_radius = 0;
  int cell_size = 8;
};
void look_from(const View& v, Scene& scene) {
  scene.camera.position = v.position;
  scene.camera.type = v.type;
  scene.camera.lens_radius = v.lens_radius;
  scene.camera.fov = v.fov;
  scene.camera.width = 3;
  scene.render.cell_size = v.cell_size;
}
const char* const kPerspective = "perspective";
// Along all axes both ways, along diagonals, in parallel, through a lens, from within.
const View kViews[] = {{{0, -7, 1.5}},
                       {{0.2, 7, 1}, 26.5, kPerspective, 0, 16},
                       {{7, 0.3, 1.5}},
                       {{-6, 0, 2.5}, 26.5, kPerspective, 0, 4},
                       {{0.1, 0, 9}},
                       {{0.1, 0, -6}},
                       {{-4, -4, 5}, 20},
                       {{3, -3, -4}, 26.5, "orthographic"},
                       {{0, -7, 1.5}, 15, kPerspective, 0.001},
                       {{0.1, 0.2, 1.6}},
                       {{0.3, 0.4, 1.63}}};

// Rays of fine pixels are walked together, with looks so near to each other that next to nothing is passed. A straight
// line through the densities on both sides of the surface would turn the gradient by 5 %.
TEST(Isosurface, LiesWhereFineStepsFindIt) {
  for (const View& v : kViews) {
    Scene scene = test::demo("smoke", 400);
    look_from(v, scene);
    const Found found = against_fine_steps(scene, 4, 14);
    EXPECT_GE(found.together, found.covered);
    EXPECT_EQ(found.wrong, 0);
    EXPECT_GT(found.covered, 150);
    EXPECT_LE(found.other, 0.001 * found.covered);
    EXPECT_LT(found.turned, 0.02 * found.covered);
  }
}

// Those of coarse pixels are walked alone, in steps of a voxel: some of what sticks out is passed.
TEST(Isosurface, OfCoarsePixelsLiesThereNearly) {
  Scene scene = test::demo("smoke", 400);
  scene.camera.fov = 120;
  const Found found = against_fine_steps(scene, 140, 3);
  EXPECT_EQ(found.together, 0);
  EXPECT_EQ(found.wrong, 0);
  EXPECT_GT(found.covered, 150);
  EXPECT_LE(found.other, 0.01 * found.covered);
  EXPECT_LT(found.turned, 0.05 * found.covered);
}

// Blocks as far as the grid's sides, with gaps between them.
TEST(Isosurface, OfBlocks) {
  const test::TemporaryFolder folder;
  test::write_affine_vdb(
      folder / "blocks.vdb", {ivec3(0), ivec3(40, 43, 59)}, test::translation({-1, -1, 0}) * test::scaling(dvec3(0.05)),
      [](const ivec3& v) {
        const ivec3 block = (v + 5) / 9;
        Rng rng(hash_combine(static_cast<uint64_t>(block.x * 16 + block.y), static_cast<uint64_t>(block.z)));
        return block == ivec3(0) || rng.uniform() < 0.08 ? 1.0f : 0.0f;
      });
  for (const View& v : kViews) {
    Scene scene = test::demo("smoke", 400);
    look_from(v, scene);
    scene.volumes[0].file = folder / "blocks.vdb";
    scene.volumes[0].grid = "density";
    scene.volumes[0].object_to_world = dmat4(1);
    scene.render.surface_density = 0.5;
    const Found found = against_fine_steps(scene, 4, 14);
    EXPECT_GE(found.together, found.covered);
    EXPECT_EQ(found.wrong, 0);
    EXPECT_GT(found.covered, 150);
    EXPECT_LE(found.other, 0.05 * found.covered) << "edges and corners";
    EXPECT_LT(found.turned, 0.04 * found.covered);
  }
}

// A grid that begins beside a cell's face, so that some rays of a bundle are in it and others not yet: windows reach
// beyond its first cell. What a ray finds there depends neither on the others nor on how many are walked at once.
TEST(Isosurface, OfRaysThatEnterTheGridOneByOne) {
  const test::TemporaryFolder folder;
  test::write_affine_vdb(folder / "low.vdb", {ivec3(1), ivec3(40)}, dmat4(1), [](const ivec3& v) {
    return static_cast<float>(1 + std::sin(0.7 * v.x) * std::sin(0.6 * v.y + 0.3) * std::sin(0.5 * v.z));
  });
  Scene scene = test::scene_of(folder / "low.vdb", 0.1, 0.8, 0);
  scene.film.width = scene.film.height = 400;
  scene.camera.position = {120, -30, 21}, scene.camera.look_at = {20, 3, 20}, scene.camera.up = {0, 0, 1};
  scene.camera.fov = 20;
  const Found found = against_fine_steps(scene, 3, 5);
  EXPECT_GE(found.together, found.covered);
  EXPECT_EQ(found.wrong, 0);
  EXPECT_GT(found.covered, 3000);

  RenderJob job;
  job.spp = 64, job.crop = {140, 130, 204, 194};
  const PreparedScene prepared(scene, LayerRequest::of({"gradient", "coverage"}, true));
  const Layers best = prepared.render(job, {}).layers;
  test::on_every_target(
      [&](const std::string& name) { test::expect_same_bits(best, prepared.render(job, {}).layers, name); });
}

// What the walk to the surface finds does not depend on the cells either: the marked voxels are the same.
TEST(Isosurface, IsTheSameInCellsOfEverySize) {
  Scene scene = test::demo("smoke", 64);
  std::array<Plane, 2> coverage, gradient;
  for (const int k : {0, 1}) {
    scene.render.cell_size = k ? 16 : 4;
    const Layers frame =
        PreparedScene(scene, LayerRequest::of({"coverage", "gradient"}, false)).render(8, 1, {}).layers;
    coverage[k] = frame.at("coverage.A");
    gradient[k] = frame.at("gradient.X");
  }
  double difference = 0, covered = 0;
  for (int y = 0; y < coverage[0].height(); ++y)
    for (int x = 0; x < coverage[0].width(); ++x) {
      covered += coverage[0](x, y);
      difference += std::abs(coverage[0](x, y) - coverage[1](x, y)) + std::abs(gradient[0](x, y) - gradient[1](x, y));
    }
  EXPECT_GT(covered, 300);
  EXPECT_LT(difference, 0.05 * covered);  // steps end at the cells' faces
}

}  // namespace
}  // namespace brume
