// Scenes that are prepared once and rendered many times, and scenes of arrays.

#include "workflows/scene_cache.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.h"
#include "filters/api/registry.h"
#include "image/exr_io.h"
#include "render/files/mesh.h"
#include "render/scene/scene_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "volume/array_volume.h"
#include "workflows/compare_frames.h"
#include "workflows/denoise_frame.h"
#include "workflows/guide_frame.h"
#include "workflows/merge_frames.h"
#include "workflows/render_frame.h"

namespace brume {
namespace {

const char* const kText =
    "[camera]\nposition = [0, -5, 1]\nlook_at = [0, 0, 0]\n[film]\nwidth = 24\nheight = 20\n"
    "[environment]\nradiance = [0.3, 0.4, 0.6]\n"
    "[[volumes]]\nsigma_t = 4\nalbedo = 0.9\nvoxel_size = 0.1\norigin = [-0.8, -0.8, -0.8]\n"
    "[[lights]]\ntype = \"sun\"\ndirection = [1, -1, 2]\nirradiance = 2\n"
    "[[surfaces]]\nalbedo = 0.5\n";

/// A ball of density above a triangle, in memory.
SceneSource scene_in_memory() {
  std::vector<float> values;
  for (int i = 0; i < 17 * 17 * 17; ++i) {
    const dvec3 p(i / 289 - 8, i / 17 % 17 - 8, i % 17 - 8);
    values.push_back(static_cast<float>(std::max(0.0, 1 - glm::length(p) / 8)));
  }
  VoxelArray view;
  view.data = reinterpret_cast<const std::byte*>(values.data());
  view.size = ivec3(17);
  view.stride = {4 * 289, 4 * 17, 4};
  TriangleMesh mesh;
  mesh.positions = {{-4, -4, -1}, {4, -4, -1}, {0, 6, -1}};
  mesh.triangles.emplace_back(0, 1, 2);
  SceneSource source;
  source.path = "memory.toml";
  source.text = kText;
  source.arrays.volumes[0] = grids_of_arrays({.density = view});
  source.arrays.meshes[0] = {std::make_shared<const TriangleMesh>(mesh), content_of(mesh)};
  return source;
}

Layers rendered(const SceneSource& source, const std::vector<std::string>& more, const LayerRequest& layers,
                SceneCache* cache) {
  RenderOptions options;
  options.scene = source.path;
  options.scene_text = source.text;
  options.arrays = source.arrays;
  options.overrides = more;
  options.spp = 3;
  options.layers = layers;
  options.scenes = cache;
  return render_frame(options, {}).layers;
}

TEST(SceneCache, EveryRenderHasTheBitsOfASceneMadeAnew) {
  const SceneSource source = scene_in_memory();
  SceneCache cache;
  LayerRequest plain, guides, all = LayerRequest::of({"all"}, true);
  plain.names = {};
  guides.names = {"direct"};
  guides.guides = true;
  const std::pair<std::vector<std::string>, LayerRequest> steps[] = {
      {{}, plain},
      {{"camera.position=[2, -5, 1]"}, all},
      {{"camera.fov=30", "render.surface_density=0.2"}, all},
      {{"film.width=160", "film.height=140"}, guides},
      {{"lights.0.irradiance=5"}, guides},
      {{"camera.shutter=[0, 1]", "camera.position_end=[1, -5, 1]"}, guides},
      {{"render.max_events=2", "render.lookup=interpolated"}, plain},
      {{"volumes.0.voxel_size=[0.1, 0.2, 0.1]"}, guides},
      {{}, guides}};
  for (const auto& [more, layers] : steps)
    test::expect_same_bits(rendered(source, more, layers, &cache), rendered(source, more, layers, nullptr),
                           more.empty() ? "unchanged" : more[0]);
}

TEST(SceneCache, CountsWhatItReadsPreparesAndSolves) {
  SceneCache cache;
  LayerRequest guides;
  guides.names = {};
  guides.guides = true;
  const auto counts_after = [&](const std::vector<std::string>& overrides) {
    std::vector<std::string> all = {"film.width=16", "film.height=16"};
    all.insert(all.end(), overrides.begin(), overrides.end());
    Scene scene = read_scene(test::source("data/scenes/fire.toml"), all);
    PreparedScene& prepared = cache.prepare(std::move(scene), guides, {});
    prepared.guides(8);
    const SceneCache::Counts c = cache.counts();
    return std::array{c.read, c.prepared, c.lights_solved};
  };
  const auto first = counts_after({});
  EXPECT_EQ(first, (std::array<size_t, 3>{first[0], 1, 1}));
  EXPECT_GE(first[0], 3u) << "density, temperature and meshes";
  EXPECT_EQ(counts_after({"camera.position=[5, -5, 5]", "film.exposure=3", "render.spp=3"}), first);
  const auto changed = counts_after({"volumes.0.g=0.5"});
  EXPECT_EQ(changed, (std::array<size_t, 3>{first[0], 2, 2})) << "files are read once";
  EXPECT_EQ(counts_after({}), changed) << "the scene before is kept";
  for (const char* g : {"volumes.0.g=0.1", "volumes.0.g=0.2", "volumes.0.g=0.3"}) counts_after({g});
  EXPECT_EQ(counts_after({}), (std::array<size_t, 3>{first[0], 6, 6})) << "three are kept, counts go on";
  cache.forget();
  EXPECT_EQ(counts_after({})[0], 2 * first[0]) << "read anew";
}

TEST(SceneCache, StaysAsItWasWhereAChangeIsRefused) {
  const SceneSource source = scene_in_memory();
  SceneCache cache;
  LayerRequest plain;
  const Layers before = rendered(source, {}, plain, &cache);
  EXPECT_THROW(rendered(source, {"camera.up=[0, 0, 0]"}, plain, &cache), InputError);
  EXPECT_THROW(
      rendered(source, {"surfaces.0.object_to_world=[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]"}, plain, &cache),
      InputError);
  test::expect_same_bits(rendered(source, {}, plain, &cache), before);
  EXPECT_EQ(cache.counts().prepared, 1u);
}

TEST(SceneOfArrays, HasTheErrorsOfASceneFile) {
  SceneSource source = scene_in_memory();
  const auto error_of = [&](const std::vector<std::string>& more) -> std::string {
    try {
      source.scene(more);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(error_of({}), "");
  const auto holds = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  EXPECT_TRUE(holds(error_of({"volumes.0.voxel_size=-1"}), "'voxel_size' is out of range"));
  EXPECT_TRUE(holds(error_of({"volumes.0.voxel=1"}), "did you mean 'voxel_size'?"));
  EXPECT_TRUE(holds(error_of({"volumes.0.file=a.vdb"}), "'file' stands beside arrays"));
  EXPECT_TRUE(holds(error_of({"volumes.0.shape=box"}), "arrays stand beside shape"));
  EXPECT_TRUE(holds(error_of({"surfaces.0.file=a.obj"}), "'file' stands beside arrays"));
  source.arrays.volumes[2] = source.arrays.volumes[0];
  EXPECT_TRUE(holds(error_of({}), "volumes.2: arrays, but the scene has 1 volumes, counted from 0"));
  source.arrays.volumes.clear();
  EXPECT_TRUE(holds(error_of({}), "unknown key '")) << "what places arrays is of arrays alone";
}

TEST(SceneOfArrays, IsKnownByItsValues) {
  const SceneSource source = scene_in_memory();
  const std::string hash = source.scene().hash;
  EXPECT_EQ(scene_in_memory().scene().hash, hash);
  EXPECT_NE(source.scene({"volumes.0.origin=[0, 0, 0]"}).hash, hash);
  SceneSource other = source;
  other.arrays.volumes[0] = std::make_shared<const VolumeGrids>(*source.arrays.volumes.at(0));
  EXPECT_EQ(other.scene().hash, hash);
  other.arrays.meshes[0].content += "x";
  EXPECT_NE(other.scene().hash, hash);
  EXPECT_NE(source.as_file().find("voxel_size = 0.1"), std::string::npos);
}

TEST(InMemory, PartsMergeSequencesAreCleanedAndComparedAsInFiles) {
  const test::TemporaryFolder folder;
  const SceneSource source = scene_in_memory();
  SceneCache cache;
  LayerRequest layers;
  layers.names = {"direct", "indirect"};
  layers.guides = true;
  RenderOptions options;
  options.scene = source.path;
  options.scene_text = source.text;
  options.arrays = source.arrays;
  options.layers = layers;
  options.spp = 4;
  options.scenes = &cache;
  const auto frame = [&](int number, std::optional<RenderOptions::Part> part) {
    RenderOptions own = options;
    own.overrides = {"render.frame=" + std::to_string(number)};
    own.part = part;
    return render_frame(own, {}).layers;
  };
  const Layers whole = frame(1, {}), a = frame(1, RenderOptions::Part{1, 2}), b = frame(1, RenderOptions::Part{2, 2});
  write_exr(folder / "b.exr", b);
  MergeOptions merge;
  merge.parts = {{"a", {}, &a}, RenderPart::of_file(folder / "b.exr")};
  test::expect_same_bits(*merge_frames(merge, {}), whole, "merged");
  merge.parts = {{"a", {}, &a}, {"whole", {}, &whole}};
  EXPECT_THROW(merge_frames(merge, {}), InputError);

  std::vector<Layers> shot;
  for (int n = 0; n < 3; ++n) {
    shot.push_back(frame(n, {}));
    write_exr(folder / ("shot." + std::to_string(n) + ".exr"), shot.back());
  }
  DenoiseOptions denoise;
  denoise.filters = {parse_filter("transport_regression")};
  std::vector<size_t> let_go;
  const std::vector<Layers> clean = denoise_frames(
      3,
      [&](size_t i) {
        return MemoryFrame{"frame", &shot[i], nullptr};
      },
      [&](size_t i) { let_go.push_back(i); }, denoise, {});
  denoise_sequence({folder / "shot.#.exr", {}, {}, folder / "clean.#.exr", {}}, {0, 1, 2}, denoise, {});
  SequenceComparison comparison({}, {}, {0, 1, 2, 3});
  for (int n = 0; n < 3; ++n) {
    const Layers file = read_exr(folder / ("clean." + std::to_string(n) + ".exr"));
    test::expect_same_bits(clean[static_cast<size_t>(n)], file, "clean");
    comparison.add({"a", clean[static_cast<size_t>(n)]}, {"b", file}, {}, {});
  }
  EXPECT_EQ(comparison.whole().mean_lab_rms, 0);
  EXPECT_EQ(comparison.whole().temporal->temporal_error, 0);
  EXPECT_THROW(comparison.add({"a", Layers(3, 3)}, {"b", Layers(3, 3)}, {}, {}), InputError);

  // Guides of a frame in memory, and of its file.
  GuideOptions guides;
  guides.scene = source;
  guides.like = GuidedFrame::of(whole, "the frame");
  guides.scenes = &cache;
  const Layers here = guide_frame(guided_scene(guides, {}), guides, {}).layers;
  write_exr(folder / "whole.exr", whole);
  guides.like = GuidedFrame::of_file(folder / "whole.exr");
  guides.scenes = nullptr;
  test::expect_same_bits(here, guide_frame(guided_scene(guides, {}), guides, {}).layers, "guides");
  for (const auto& [name, plane] : here.channels()) EXPECT_TRUE(whole.find(name)) << name;
}

}  // namespace
}  // namespace brume
