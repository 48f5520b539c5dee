// Bare volumes by every way in: what is said is known before a scene is made up around them.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "base/error.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_outline.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "workflows/scene.h"
#include "workflows/scene_source.h"
#include "workflows/view/viewed_scene.h"

namespace brume {
namespace {

using Assignments = std::vector<std::string>;

class BareVolumes : public ::testing::Test {
 protected:
  BareVolumes() {
    for (int frame = 1; frame <= 3; ++frame)
      test::write_grids_vdb(folder_ / fmt::format("a.000{}.vdb", frame), {{0, 0, 0}, {40, 24, 24}},
                            {{"density", [frame](const ivec3& v) {
                                return glm::distance(dvec3(v), dvec3(12 * frame - 4, 12, 12)) < 6 ? 1.0f : 0.0f;
                              }}});
  }
  std::filesystem::path file() const { return folder_ / "a.0002.vdb"; }
  std::filesystem::path pattern() const { return folder_ / "a.####.vdb"; }
  test::TemporaryFolder folder_;
};

const Assignments kPortrait = {"film.width=20", "film.height=60"};

double distance_of(const Scene& scene) {
  return glm::distance(scene.camera.position, scene.camera.look_at);
}

TEST_F(BareVolumes, APictureOfAnotherShapeHasAnotherCameraHoweverItIsAskedFor) {
  const double landscape = distance_of(load_scene(file(), {}).scene);
  const Scene portrait = load_scene(file(), kPortrait).scene;
  EXPECT_GT(distance_of(portrait), 2 * landscape);
  EXPECT_TRUE(portrait.volumes[0].grids) << "what was read is used";

  SceneSource source = SceneSource::of_file(file(), kPortrait);
  source.overrides = kPortrait;
  EXPECT_EQ(source.scene().camera.position, portrait.camera.position);

  ViewedScene said(file(), {}, {}, LayerRequest());
  said.show({}, ivec2(20, 60), std::nullopt, {});
  EXPECT_EQ(said.prepared().scene().camera.position, portrait.camera.position) << "by the window";
  said.show({}, ivec2(60, 20), std::nullopt, {});
  EXPECT_EQ(said.prepared().scene().camera.position, portrait.camera.position) << "another window turns no camera";
}

TEST_F(BareVolumes, ASequenceIsSeenByOneCamera) {
  ViewedScene viewed(pattern(), {1, 2, 3}, {}, LayerRequest());
  viewed.show({}, ivec2(60, 40), 1, {});
  const dvec3 first = viewed.prepared().scene().camera.position;
  viewed.show({}, ivec2(60, 40), 3, {});
  EXPECT_EQ(viewed.prepared().scene().camera.position, first);
  EXPECT_GT(distance_of(viewed.prepared().scene()), 1.5 * distance_of(load_scene(file(), {}).scene));
  // The pattern alone is the first frame in the scene of all that are there.
  const Scene alone = load_scene(pattern(), {}).scene;
  EXPECT_EQ(alone.volumes[0].file, folder_ / "a.0001.vdb");
  EXPECT_EQ(alone.camera.look_at, viewed.prepared().scene().camera.look_at);
  EXPECT_EQ(load_scene(pattern(), Assignments{"render.frame=3"}).scene.volumes[0].file, folder_ / "a.0003.vdb");
}

TEST_F(BareVolumes, AMissingFirstFrameDoesNotHideTheOthers) {
  std::filesystem::remove(folder_ / "a.0001.vdb");
  ViewedScene viewed(pattern(), {1, 2, 3}, {}, LayerRequest());
  EXPECT_THROW(viewed.show({}, ivec2(60, 40), 1, {}), InputError);
  viewed.show({}, ivec2(60, 40), 2, {});
  EXPECT_FALSE(viewed.prepared().context().media.empty());
}

TEST_F(BareVolumes, AGridMayBeChosenWhereNoneIsPlain) {
  const auto box = [](const ivec3&) { return 1.0f; };
  test::write_grids_vdb(folder_ / "two.vdb", {{0, 0, 0}, {7, 7, 7}}, {{"soot", box}, {"dust", box}});
  ViewedScene viewed(folder_ / "two.vdb", {}, {}, LayerRequest());
  EXPECT_THROW(viewed.show({}, ivec2(60, 40), std::nullopt, {}), InputError);
  viewed.show({"volumes.0.grid=dust"}, ivec2(60, 40), std::nullopt, {});
  EXPECT_EQ(viewed.prepared().scene().volumes[0].grid, "dust");
}

TEST_F(BareVolumes, WhatIsSavedHasWhatWasSaid) {
  const Assignments said = {"camera.fov=21.3", "environment.file=sky.exr", "volumes.0.g=0.1"};
  test::write_file(folder_ / "sky.exr", "");
  const VolumeScene made = scene_for_volume(file(), said);
  const std::string here = moved_scene(made.text("a.0002.vdb"), folder_ / "s.toml", said, file());
  EXPECT_NE(here.find("file = \"sky.exr\""), std::string::npos) << here;
  EXPECT_NE(here.find("fov = 21.3\n"), std::string::npos) << here;
  EXPECT_NE(here.find("g = 0.1\n"), std::string::npos) << here;
  const test::TemporaryFolder elsewhere;
  const std::string there = moved_scene(made.text("../a.0002.vdb"), elsewhere / "s.toml", said, file());
  EXPECT_NE(there.find("file = \"" + (folder_ / "sky.exr").string() + "\""), std::string::npos) << there;
  EXPECT_NE(there.find("file = \"../a.0002.vdb\""), std::string::npos) << "as it was given";
}

TEST(EditedScene, NumbersAreAsShortAsTheyCanBeAndTextIsEscaped) {
  const std::string text = "name = \"a\"\n[camera]\nposition = [0, 1, 2]\nlook_at = [0, 0, 0]\n";
  const Assignments said = {"camera.position=[-5.94205, 0.1, 1e-20]", "camera.fov=30.0", "name=12\" \\ it's"};
  const std::string edited = edited_scene(text, "/s.toml", said);
  EXPECT_NE(edited.find("position = [-5.94205, 0.1, 1e-20]\n"), std::string::npos) << edited;
  EXPECT_NE(edited.find("fov = 30.0\n"), std::string::npos) << edited;
  EXPECT_EQ(parse_scene_alone(edited, "/s.toml").name, "12\" \\ it's") << edited;
}

}  // namespace
}  // namespace brume
