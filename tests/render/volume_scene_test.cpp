// What is made up around bare volumes: choice of grids, framing, fire, text.

#include "render/world/volume_scene.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <regex>

#include "base/error.h"
#include "render/scene/scene_io.h"
#include "render/world/camera.h"
#include "render/world/media.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using Assignments = std::vector<std::string>;

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A round puff of density up to 1, lower towards its rim.
float puff(const ivec3& v, const dvec3& middle = dvec3(16), double radius = 10) {
  return static_cast<float>(std::max(0.0, 1 - glm::distance(dvec3(v), middle) / radius));
}
const VoxelBox kBox{{0, 0, 0}, {32, 32, 32}};

float round_puff(const ivec3& v) {
  return puff(v);
}

Scene scene_of(const VolumeScene& made, const fs::path& file, const Assignments& assignments = {}) {
  return parse_scene_alone(made.text(file.filename().string()), file, assignments);
}
Scene guessed(const fs::path& file, const Assignments& assignments = {}) {
  return scene_of(scene_for_volume(file, assignments), file, assignments);
}

/// How far a density reaches from the middle of the picture, its edges being at 1.
/// @param least  density that counts
dvec2 extent_in_picture(const Scene& scene, const fs::path& file, double least = 0.05) {
  const Camera camera(scene.camera, scene.film.width, scene.film.height);
  const auto m = camera.world_to_ndc();
  const ScalarField field = load_scalar(file, {scene.volumes[0].grid});
  dvec2 most(0);
  const ivec3 end(field.bricks.support_hi());
  ivec3 v;
  for (v.x = 0; v.x <= end.x; ++v.x)
    for (v.y = 0; v.y <= end.y; ++v.y)
      for (v.z = 0; v.z <= end.z; ++v.z) {
        if (!(field.bricks.voxel(v) > least)) continue;
        const glm::dvec4 p = scene.volumes[0].object_to_world * field.world_from_index *
                             glm::dvec4(dvec3(v + field.bricks.origin()), 1.0);
        double clip[4] = {};
        for (size_t column = 0; column < 4; ++column)
          for (size_t row = 0; row < 4; ++row)
            clip[column] += p[static_cast<int>(row)] * static_cast<double>(m[row * 4 + column]);
        EXPECT_GT(clip[3], 0) << "it lies behind the camera";
        most = glm::max(most, glm::abs(dvec2(clip[0], clip[1]) / clip[3]));
      }
  return most;
}

/// All of it is shown, and not much more.
void expect_framed(const Scene& scene, const fs::path& file, const std::string& what, double least = 0.05) {
  const dvec2 extent = extent_in_picture(scene, file, least);
  EXPECT_LT(extent.x, 1) << what;
  EXPECT_LT(extent.y, 1) << what;
  EXPECT_GT(std::max(extent.x, extent.y), 0.6) << what;
}

class BareVolume : public ::testing::Test {
 protected:
  fs::path path(const std::string& name) const { return folder_ / name; }
  fs::path write(const std::string& name, const std::vector<test::NamedGrid>& grids) const {
    test::write_grids_vdb(path(name), kBox, grids);
    return path(name);
  }
  test::TemporaryFolder folder_;
};

std::function<float(const ivec3&)> times(float factor) {
  return [factor](const ivec3& v) { return factor * puff(v); };
}

TEST_F(BareVolume, IsFramedInPicturesOfEveryShape) {
  const fs::path file = write("a.vdb", {{"density", round_puff}});
  const std::vector<std::string> portrait = {"film.width=30", "film.height=60"};
  for (const Assignments& said :
       {Assignments{},
        portrait,
        {"film.width=600", "film.height=20"},
        {"film={width=30, height=60}"},
        {"film.width=30", "film.height=60", "camera.fov_axis=x", "camera.fov=70"},
        {"camera.fov=5"},
        {"camera.fov_axis=shorter", "film.width=30"},
        {"camera.pixel_aspect=0.25"},
        {"camera.up=[1, 0, 0]"},
        {"camera.shift=[0.2, 0]"},
        {"camera.type=orthographic", "film.width=30", "film.height=60"},
        {"camera.look_at=[12, 16, 20]"},
        {"volumes.0.object_to_world=[[9, 0, 0, 100], [0, 1, 0, 0], [0, 0, 0.5, -3], [0, 0, 0, 1]]"}}) {
    const Scene scene = guessed(file, said);
    const dvec2 extent = extent_in_picture(scene, file);
    EXPECT_LT(std::max(extent.x, extent.y), 1) << fmt::format("{}", fmt::join(said, " "));
    EXPECT_GT(std::max(extent.x, extent.y), 0.5) << fmt::format("{}", fmt::join(said, " "));
  }
}

TEST_F(BareVolume, WhatIsSaidIsNotGuessed) {
  const fs::path file = write("a.vdb", {{"density", round_puff}});
  const auto assumed = [&](const Assignments& said) {
    return fmt::format("{}", fmt::join(scene_for_volume(file, said).all_assumptions(), "\n"));
  };
  EXPECT_TRUE(holds(assumed({}), "seen from [") && holds(assumed({}), "volumes.0.sigma_t = "));
  EXPECT_FALSE(holds(assumed({"volumes.0.sigma_t=5"}), "volumes.0.sigma_t = "));
  EXPECT_FALSE(holds(assumed({"volumes.0.preset=principled"}), "volumes.0.sigma_t = "));
  EXPECT_FALSE(holds(assumed({"camera.position=[0, -90, 0]"}), "seen from"));
  EXPECT_EQ(guessed(file, {"volumes.0.preset=principled", "volumes.0.density=3"}).volumes[0].sigma_t.x, 3)
      << "and does not stand against what is guessed";
  EXPECT_EQ(guessed(file, {"volumes.0.sigma_a=1", "volumes.0.sigma_s=2"}).volumes[0].sigma_t.x, 3);
  EXPECT_DOUBLE_EQ(guessed(file, {"volumes.0.density=2"}).volumes[0].sigma_t.x, 2 * guessed(file).volumes[0].sigma_t.x);
  const Scene keys = guessed(file, {"camera.keys=[[0, 0, -90, 0, 16, 16, 16], [9, 9, -90, 0, 16, 16, 16]]"});
  EXPECT_EQ(keys.camera.position, dvec3(0, -90, 0));
  const Scene sky = guessed(file, {"environment.sky=preetham"});
  EXPECT_TRUE(sky.lights.empty()) << "the sky has a sun";
  EXPECT_EQ(sky.environment.radiance, dvec3(1));
  EXPECT_THROW(scene_for_volume(file, Assignments{"volumes.0.sigma=5"}), InputError);
}

TEST_F(BareVolume, TheGridThatIsSaidDecidesTheGuess) {
  const auto small = [](const ivec3& v) { return puff(v, dvec3(6), 4); };
  const fs::path file = write("e.vdb", {{"density", round_puff}, {"soot", small}});
  const Scene soot = guessed(file, {"volumes.0.grid=soot"});
  EXPECT_EQ(soot.volumes[0].grid, "soot");
  expect_framed(soot, file, "soot");
  EXPECT_EQ(guessed(file).volumes[0].grid, "density");
  try {
    scene_for_volume(file, Assignments{"volumes.0.grid=Soot"});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_TRUE(holds(error.what(), "no grid 'Soot'; the file has: density (float), soot (float)")) << error.what();
  }
}

TEST_F(BareVolume, ALevelSetIsFilledWhereThatIsSaid) {
  const fs::path file = test::source("tests/data/grids/level_set.vdb");
  EXPECT_THROW(scene_for_volume(file), InputError);
  const Assignments said = {"volumes.0.convert_level_set=true"};
  const VolumeScene made = scene_for_volume(file, said);
  EXPECT_FALSE(made.density) << "what was converted is not what the file stores";
  EXPECT_TRUE(scene_of(made, file, said).volumes[0].convert_level_set);
}

/// The camera's distance from the middle of the puff.
double distance_of(const Scene& scene) {
  return glm::distance(scene.camera.position, dvec3(16));
}

TEST_F(BareVolume, VoxelsAstrayDoNotMoveTheCamera) {
  const double plain = distance_of(guessed(write("plain.vdb", {{"density", round_puff}})));
  for (const ivec3& astray :
       {ivec3(100, 0, 0), ivec3(3000, 16, 16), ivec3(16, -3000, 16), ivec3(16, 3000, 16), ivec3(0, 0, 400000)})
    for (const float value : {1e-6f, 1.0f}) {
      const fs::path file = path("stray.vdb");
      test::write_grids_vdb(file, kBox, {{"density", round_puff}});
      test::add_voxel(file, "density", astray, value);
      const Scene scene = guessed(file);
      EXPECT_NEAR(distance_of(scene) / plain, 1, 0.05)
          << astray.x << " " << astray.y << " " << astray.z << " " << value;
      EXPECT_LT(glm::distance(scene.camera.look_at, dvec3(16)), 1.5);
    }
}

TEST_F(BareVolume, FaintVoxelsEverywhereDoNotMoveTheCamera) {
  const double plain = distance_of(guessed(write("plain.vdb", {{"density", round_puff}})));
  test::write_grids_vdb(path("haze.vdb"), {{-60, -70, -50}, {90, 80, 100}},
                        {{"density", [](const ivec3& v) { return std::max(1e-6f, puff(v)); }}});
  EXPECT_NEAR(distance_of(guessed(path("haze.vdb"))) / plain, 1, 0.05);
}

TEST_F(BareVolume, ADamagedVoxelDoesNotHideTheRest) {
  const fs::path file =
      write("spike.vdb", {{"density", [](const ivec3& v) { return v == ivec3(20, 16, 16) ? 1e6f : puff(v); }}});
  EXPECT_NEAR(distance_of(guessed(file)) / distance_of(guessed(write("plain.vdb", {{"density", round_puff}}))), 1, 0.1);
}

TEST_F(BareVolume, ThinSmokeThatIsSeenIsNotCut) {
  // A wide veil through whose middle a thirtieth of the puff's depth is met, and a puff far away from the other.
  const auto veil = [](const ivec3& v) {
    return puff(v) + (glm::distance(dvec3(v), dvec3(16, 16, 60)) < 30 ? 0.005f : 0.0f);
  };
  const auto two = [](const ivec3& v) { return puff(v) + puff(v, dvec3(90, 16, 16), 5); };
  test::write_grids_vdb(path("veil.vdb"), {{-20, -20, -1}, {50, 50, 95}}, {{"density", veil}});
  expect_framed(guessed(path("veil.vdb")), path("veil.vdb"), "veil", 0.001);
  test::write_grids_vdb(path("two.vdb"), {{0, 0, 0}, {100, 32, 32}}, {{"density", two}});
  expect_framed(guessed(path("two.vdb")), path("two.vdb"), "two");
}

/// "temperature", "flame", "both" or "none": what the guess lets glow, and what the renderer makes of it.
std::string glowing(const fs::path& file, const Assignments& said = {}) {
  const Scene scene = guessed(file, said);
  const VolumeSettings& v = scene.volumes[0];
  const bool hot = v.temperature_grid != "none", flames = v.flame_grid != "none";
  const SceneMedia media(scene, {});
  EXPECT_EQ(media.emissions().empty(), !hot && !flames)
      << file << " " << fmt::format("{}", fmt::join(media.notes(), "\n"));
  return hot && flames ? "both" : hot ? "temperature" : flames ? "flame" : "none";
}

TEST_F(BareVolume, BurnsWhereTheFileSaysThereIsFire) {
  const std::function<float(const ivec3&)> empty;
  const auto zero = [](const ivec3& v) { return puff(v) > 0 ? -1e-30f : 0.0f; };  // active, and no flame
  const test::NamedGrid density{"density", round_puff};
  const auto of = [&](std::vector<test::NamedGrid> grids) {
    grids.insert(grids.begin(), density);
    return glowing(write("f.vdb", grids));
  };
  // Blender: smoke without fire stores its heat and an empty flame.
  EXPECT_EQ(of({{"flame", empty}, {"temperature", times(1.5f)}}), "none");
  EXPECT_EQ(of({{"flame", zero}, {"temperature", times(1.5f)}}), "none");
  EXPECT_EQ(of({{"flame_noise", empty}}), "none");
  EXPECT_EQ(of({{"flame_noise", round_puff}}), "flame");
  EXPECT_EQ(of({{"flame", round_puff}, {"temperature", times(3)}}), "temperature");
  // Houdini, EmberGen and others.
  EXPECT_EQ(of({{"temperature", times(2)}}), "none") << "no kelvin, no fuel: warm smoke";
  EXPECT_EQ(of({{"temperature", times(2)}, {"heat", round_puff}}), "temperature");
  EXPECT_EQ(of({{"temperature", times(2)}, {"fuel", round_puff}}), "temperature");
  EXPECT_EQ(of({{"temperature", times(1800)}}), "temperature");
  EXPECT_EQ(of({{"temperature", times(300)}}), "none") << "a warm room";
  EXPECT_EQ(of({{"flames", empty}, {"temperature", times(1800)}, {"fuel", round_puff}}), "none");
  EXPECT_EQ(of({{"temperature", times(300)}, {"flames", round_puff}}), "flame");
  EXPECT_EQ(of({{"Fire", round_puff}}), "flame");
  EXPECT_EQ(of({{"burn", round_puff}, {"Temperature", times(1)}}), "temperature");
  // What is said counts.
  const fs::path smoke = write("s.vdb", {density, {"flame", empty}, {"temperature", times(1.5f)}});
  EXPECT_EQ(glowing(smoke, {"volumes.0.temperature_grid=temperature"}), "temperature");
  const fs::path fire = write("b.vdb", {density, {"flame", round_puff}, {"temperature", times(3)}});
  EXPECT_EQ(glowing(fire, {"volumes.0.temperature_grid=none"}), "flame");
  EXPECT_EQ(glowing(fire, {"volumes.0.temperature_grid=none", "volumes.0.flame_grid=none"}), "none");
  EXPECT_EQ(guessed(fire, {"volumes.0.temperature_scale=500"}).volumes[0].temperature_scale, 500);
}

TEST_F(BareVolume, OfBlenderBurnsWhereItBurns) {
  EXPECT_EQ(glowing(test::source("data/volumes/fire.vdb")), "temperature");
  EXPECT_EQ(glowing(test::source("data/volumes/smoke.vdb")), "none");
  const auto folder = test::shared("volumes");
  if (folder.empty()) GTEST_SKIP() << "no volumes beside the project";
  EXPECT_EQ(glowing(folder / "smoke_plume_base.vdb"), "none");
  EXPECT_EQ(glowing(folder / "sequence/smoke_seq_0030.vdb"), "none");
}

TEST_F(BareVolume, FilesOfAnyNameAreNamedInTheText) {
  for (const char* name : {"12\" puff.vdb", "back\\slash.vdb", "it's.vdb", "two\nlines.vdb", "tab\tand\x7f.vdb",
                           "\xc3\xa9t\xc3\xa9.vdb", "a#b.vdb", "\\u0041.vdb"}) {
    const fs::path file = write(name, {{"density", round_puff}});
    const Scene scene = guessed(file);
    EXPECT_EQ(scene.volumes[0].file, file);
    EXPECT_EQ(scene.name, file.stem().string());
  }
}

TEST_F(BareVolume, NumbersInTheTextAreShort) {
  const fs::path file = write("a.vdb", {{"density", round_puff}});
  const std::string text = scene_for_volume(file).text("a.vdb");
  const std::regex long_number("[0-9.]{9,}");
  std::smatch found;
  EXPECT_FALSE(std::regex_search(text, found, long_number)) << text;
}

class BareSequence : public BareVolume {
 protected:
  VolumeScene guess(std::vector<int> frames = {1, 2, 3, 4}, const Assignments& said = {}) const {
    return scene_for_volumes(path("a.####.vdb"), frames, said);
  }
  Scene scene(int frame, const Assignments& said = {}) const {
    Assignments all = said;
    all.push_back(fmt::format("render.frame={}", frame));
    return parse_scene_alone(guess({1, 2, 3, 4}, said).text("a.####.vdb"), path("a.####.vdb"), all);
  }
};

TEST_F(BareSequence, ShowsAllThatMoves) {
  const auto at = [](double x, double radius) {
    return [=](const ivec3& v) { return puff(v, dvec3(x, 16, 16), radius); };
  };
  const VoxelBox box{{0, 0, 0}, {120, 32, 32}};
  int frame = 0;
  for (const double x : {12.0, 50.0, 100.0, 60.0})
    test::write_grids_vdb(path(fmt::format("a.000{}.vdb", ++frame)), box, {{"density", at(x, frame == 4 ? 11 : 9)}});
  for (int f = 1; f <= 4; ++f) {
    const Scene now = scene(f);
    const dvec2 extent = extent_in_picture(now, now.volumes[0].file);
    EXPECT_LT(std::max(extent.x, extent.y), 1) << f;
    EXPECT_EQ(now.volumes[0].sigma_t, scene(1).volumes[0].sigma_t);
  }
}

TEST_F(BareSequence, FireThatBeginsLaterBurnsFromThereOn) {
  const std::function<float(const ivec3&)> empty;
  write("a.0001.vdb", {{"density", round_puff}});
  write("a.0002.vdb", {{"density", round_puff}, {"flame", empty}, {"temperature", times(1.5f)}});
  write("a.0003.vdb", {{"density", round_puff}, {"flame", times(1)}, {"temperature", times(2)}});
  write("a.0004.vdb", {{"density", round_puff}, {"flame", times(0.5f)}, {"temperature", times(3)}});
  for (const auto& [frame, burns] : {std::pair(1, false), {2, false}, {3, true}, {4, true}}) {
    const SceneMedia media(scene(frame), {});
    EXPECT_EQ(!media.emissions().empty(), burns) << frame;
  }
  EXPECT_EQ(scene(1).volumes[0].temperature_scale, scene(4).volumes[0].temperature_scale);
}

TEST_F(BareSequence, FramesThatAreEmptyOrBadDoNotDecide) {
  const std::function<float(const ivec3&)> empty;
  test::write_grids_vdb(path("a.0001.vdb"), kBox, {});
  write("a.0002.vdb", {{"density", empty}});
  write("a.0003.vdb", {{"density", round_puff}});
  test::write_file(path("a.0004.vdb"), " BDV damaged");
  expect_framed(scene(3), path("a.0003.vdb"), "the one that holds something");
  for (const int frame : {1, 2}) EXPECT_TRUE(SceneMedia(scene(frame), {}).media().empty()) << frame;
  EXPECT_THROW(guess({1, 2}), InputError);
  EXPECT_THROW(guess({4, 5}), InputError);
}

TEST_F(BareSequence, TheGridOfMostFramesIsTaken) {
  write("a.0001.vdb", {{"smoke", round_puff}});
  for (const char* name : {"a.0002.vdb", "a.0003.vdb"}) write(name, {{"density", round_puff}});
  EXPECT_EQ(scene(2).volumes[0].grid, "density");
  try {
    SceneMedia(scene(1), {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_TRUE(holds(error.what(), "a.0001.vdb: no grid 'density'; the file has: smoke (float)")) << error.what();
  }
}

}  // namespace
}  // namespace brume
