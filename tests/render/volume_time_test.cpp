// Volumes of a sequence at another speed: which files a frame of the scene shows, and what is wrong with a table
// `time`.

#include "render/scene/volume_time.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "render/scene/instance_files.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

constexpr const char* kCamera = "[camera]\nposition = [0, 0, 0]\nlook_at = [0, 1, 0]\n";

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A folder with files of some frames, and the scenes that show them.
class Sequence {
 public:
  explicit Sequence(const std::vector<int>& frames) {
    for (const int frame : frames) test::write_file(folder_ / fmt::format("s.{:04}.vdb", frame), std::to_string(frame));
  }
  Scene scene(const std::string& keys, int frame, const std::string& more = "") const {
    return parse_scene(std::string(kCamera) + more + "[[volumes]]\nfile = \"s.####.vdb\"\n" + keys,
                       folder_ / "scene.toml", std::vector{fmt::format("render.frame={}", frame)});
  }
  std::string error(const std::string& keys, int frame = 1) const {
    try {
      scene(keys, frame);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  /// "3" or "3 + 0.25 to 4": the files and what is between them.
  std::string shown(const std::string& keys, int frame) const {
    const Scene s = scene(keys, frame);
    if (s.volumes.empty()) return "nothing";
    const VolumeSettings& v = s.volumes[0];
    const auto number = [](const VolumeSettings& of) {
      return std::stoi(of.file.stem().extension().string().substr(1));
    };
    if (!v.moment.later) return fmt::format("{}", number(v));
    return fmt::format("{} + {:.6g} to {}", number(v), v.moment.share, number(*v.moment.later));
  }
  std::filesystem::path operator/(const std::string& name) const { return folder_ / name; }

 private:
  test::TemporaryFolder folder_;
};

TEST(VolumeTime, ACurveMapsFrames) {
  const Sequence s({1, 2, 3, 24, 25, 26});
  const std::string curve = "time = {frame = [[1, 1], [49, 25]]}\n";
  EXPECT_EQ(s.shown(curve, 1), "1");
  EXPECT_EQ(s.shown(curve, 2), "1 + 0.5 to 2");
  EXPECT_EQ(s.shown(curve, 3), "2");
  EXPECT_EQ(s.shown(curve, 48), "24 + 0.5 to 25");
  EXPECT_EQ(s.shown(curve, 500), "25") << "at rest after the last row";
  EXPECT_EQ(s.shown(curve, 0), "1");
  EXPECT_EQ(s.shown("time = {frame = [[1, 1], [49, 25]], offset = 0.25}\n", 1), "1 + 0.25 to 2");
  EXPECT_EQ(s.shown("[volumes.time]\nframe = [[10, 26], [11, 24]]\n", 10), "26") << "backwards, in a table of its own";
  EXPECT_EQ(s.shown("", 3), "3") << "without the table the scene's frame";
}

TEST(VolumeTime, FramesPerSecondScaleTime) {
  const Sequence s({0, 1, 2, 3, 4, 5, 6});
  EXPECT_EQ(s.shown("time = {fps = 12}\n", 3), "1 + 0.5 to 2");
  EXPECT_EQ(s.shown("time = {fps = 30, scene_fps = 60, offset = 2}\n", 5), "4 + 0.5 to 5");
  EXPECT_EQ(s.shown("time = {fps = 12, between = \"nearest\"}\n", 3), "2");
  EXPECT_EQ(s.shown("time = {offset = 3}\n", 2), "5") << "at the scene's speed unless another is said";
}

TEST(VolumeTime, WhatIsBeyondTheSequence) {
  const Sequence s({3, 4, 5, 6});
  const auto at = [&](const char* beyond, const char* more, int frame) {
    return s.shown(fmt::format("time = {{beyond = \"{}\"{}}}\n", beyond, more), frame);
  };
  EXPECT_EQ(at("hold", "", 1), "3");
  EXPECT_EQ(at("hold", "", 90), "6");
  EXPECT_EQ(at("loop", "", 7), "3");
  EXPECT_EQ(at("loop", "", 2), "6");
  EXPECT_EQ(at("loop", "", 12), "4");
  EXPECT_EQ(at("loop", ", offset = 0.5", 6), "6 + 0.5 to 3") << "the last goes over into the first";
  EXPECT_EQ(at("ping_pong", "", 7), "5");
  EXPECT_EQ(at("ping_pong", "", 9), "3");
  EXPECT_EQ(at("ping_pong", "", 10), "4");
  EXPECT_EQ(at("ping_pong", ", offset = 0.25", 7), "4 + 0.75 to 5");
  EXPECT_EQ(at("empty", "", 7), "nothing");
  EXPECT_EQ(at("loop", ", first = 4, last = 5", 6), "4") << "of a part of the files";
  const std::string error = s.error("time = {beyond = \"error\"}\n", 9);
  EXPECT_TRUE(holds(error, "frame 9 of the scene is frame 9 of the volume, outside of its sequence, 3 .. 6")) << error;
  EXPECT_TRUE(holds(error, "there are files of the frames 3-6")) << error;
}

TEST(VolumeTime, FilesThatAreMissing) {
  const Sequence s({1, 2, 6, 7});
  const auto at = [&](const char* missing, double frame) {
    return s.shown(fmt::format("time = {{offset = {}, missing = \"{}\"}}\n", frame, missing), 0);
  };
  EXPECT_EQ(at("hold", 4), "2");
  EXPECT_EQ(at("hold", 2.5), "2");
  EXPECT_EQ(at("between", 4), "2 + 0.5 to 6");
  EXPECT_EQ(at("between", 2.4), "2 + 0.1 to 6");
  EXPECT_EQ(at("between", 6.5), "6 + 0.5 to 7");
  const std::string error = s.error("time = {offset = 3}\n");
  EXPECT_TRUE(holds(error, "frame 1 of the scene is frame 4 of the volume, and a file for that is missing")) << error;
  EXPECT_TRUE(holds(error, "there are files of the frames 1-2, 6-7")) << error;
  EXPECT_EQ(s.scene("time = {offset = 4, missing = \"between\"}\n", 0).volumes[0].moment.frames, 4);
}

// Motion blur is as long as the volume's own way over the shutter.
TEST(VolumeTime, TheShutterSeesTheVolumesOwnSpeed) {
  const Sequence s({1, 2, 3, 4});
  const std::string shutter = "shutter = [-0.25, 0.25]\n";
  const auto rate = [&](const std::string& time, int frame) {
    return s.scene("time = {" + time + "}\n", frame, shutter).volumes[0].moment.rate;
  };
  EXPECT_DOUBLE_EQ(rate("fps = 12, offset = 1", 1), 0.5);
  EXPECT_DOUBLE_EQ(rate("frame = [[0, 4], [6, 1]]", 2), -0.5);
  EXPECT_DOUBLE_EQ(rate("beyond = \"ping_pong\"", 5), -1);
  EXPECT_DOUBLE_EQ(rate("beyond = \"hold\"", 9), 0);
}

TEST(VolumeTime, WrongTablesAreRefused) {
  const Sequence s({1, 2});
  const auto expect = [&](const std::string& keys, const std::string& part) {
    const std::string error = s.error(keys);
    EXPECT_TRUE(holds(error, part)) << keys << error;
    EXPECT_TRUE(holds(error, "scene.toml")) << error;
  };
  expect("time = 3\n", "is an integer");
  expect("time = {speed = 2}\n", "unknown key 'speed' in 'time' of [[volumes]]");
  expect("time = {beyond = \"lop\"}\n", "'beyond' cannot be 'lop'; did you mean 'loop'");
  expect("time = {frame = [[1, 1]]}\n", "'frame' has one row");
  expect("time = {frame = [[1, 1], [1, 2]]}\n", "'frame' does not rise");
  expect("time = {frame = [[1, 1], [2, 2]], fps = 12}\n", "'fps' stands beside 'frame'");
  expect("time = {scene_fps = 12}\n", "'scene_fps' stands without 'fps'");
  expect("time = {fps = 0}\n", "'fps' is out of range");
  expect("time = {first = 2, last = 1}\n", "'last' is 1, before first = 2");
  expect("time = {first = 9}\n", "the sequence ends with frame 2, before it begins with 9");
  const auto of_file = [&](const std::string& file) {
    return test::error_of([&] {
      parse_scene(std::string(kCamera) + "[[volumes]]\nfile = \"" + file + "\"\ntime = {offset = 1}\n", s / "t.toml");
    });
  };
  EXPECT_TRUE(holds(of_file("s.0001.vdb"), "'time' of a volume that is no sequence"));
  EXPECT_TRUE(holds(of_file("no.####.vdb"), "'file' names a sequence without files"));
  const std::string box = test::error_of(
      [&] { parse_scene(std::string(kCamera) + "[[volumes]]\nshape = \"box\"\ntime = {offset = 1}\n", s / "t.toml"); });
  EXPECT_TRUE(holds(box, "'time' stands beside shape = \"box\"")) << box;
}

TEST(VolumeTime, TheHashFollowsWhatIsShown) {
  const Sequence s({1, 2, 3});
  const auto hash = [&](const std::string& time, int frame) { return s.scene("time = {" + time + "}\n", frame).hash; };
  EXPECT_EQ(hash("fps = 12, offset = 1", 1), hash("fps = 12, offset = 1", 1));
  EXPECT_NE(hash("fps = 12, offset = 1", 1), hash("fps = 12, offset = 1", 2));
  EXPECT_NE(hash("fps = 12, offset = 1.25", 1), hash("fps = 12, offset = 1", 1));
  EXPECT_NE(hash("fps = 12, offset = 1", 1), hash("fps = 12, offset = 1, between = \"blend\"", 1));
}

/// "3: 2 places": for each volume of a scene its file and how many places show it.
std::vector<std::string> shown_at_places(const Scene& scene) {
  std::vector<std::string> shown;
  for (size_t i = 0; i < scene.volumes.size(); ++i) {
    size_t places = 0;
    for (const InstanceSettings& s : scene.instances)
      if (static_cast<size_t>(s.volume) == i) places += s.arrays ? s.arrays->matrices.size() : s.matrices.size();
    const VolumeSettings& v = scene.volumes[i];
    shown.push_back(fmt::format("{}{}: {} places", std::stoi(v.file.stem().extension().string().substr(1)),
                                v.moment.later ? fmt::format(" + {:.6g}", v.moment.share) : "", places));
  }
  return shown;
}

TEST(VolumeTime, PlacesShowFramesOfTheirOwn) {
  const Sequence s({1, 2, 3, 4});
  test::write_file(s / "at.csv", "x,y,z,time_offset\n0,0,0,0\n1,0,0,1\n2,0,0,1\n3,0,0,4\n4,0,0,0.5\n");
  const auto shown = [&](const std::string& time, int frame, const std::string& keys = "") {
    return shown_at_places(
        s.scene("time = {" + time + "}\n[[instances]]\nvolume = 0\nfile = \"at.csv\"\n" + keys, frame));
  };
  using Shown = std::vector<std::string>;
  EXPECT_EQ(shown("beyond = \"loop\"", 1), (Shown{"1: 2 places", "2: 2 places", "1 + 0.5: 1 places"}));
  EXPECT_EQ(shown("beyond = \"loop\", between = \"nearest\"", 2, "time_offset = 1\n"),
            (Shown{"3: 2 places", "4: 3 places"}))
      << "the entry's offset comes on top";
  // Places before or after the sequence are not there; where that is all of them, the volume is not.
  EXPECT_EQ(shown("beyond = \"empty\"", 3), (Shown{"3: 1 places", "4: 2 places", "3 + 0.5: 1 places"}));
  EXPECT_EQ(shown("beyond = \"empty\"", 0), (Shown{"1: 2 places", "4: 1 places"})) << "though the volume is not there";
  EXPECT_EQ(shown("beyond = \"empty\"", 9), Shown());
  const std::string error = test::error_of([&] { shown("beyond = \"error\"", 2); });
  EXPECT_TRUE(holds(error, "instances.0: place 3, its time offset 4: frame 2 of the scene is frame 6 of the volume"))
      << error;
  EXPECT_TRUE(holds(error, "there are files of the frames 1-4")) << error;
}

TEST(VolumeTime, PlacesOfOneVolumeHaveOneMatteAndTheirFactors) {
  const Sequence s({1, 2});
  test::write_file(s / "at.csv",
                   "x,y,z,time_offset,density,tint_r,tint_g,tint_b\n0,0,0,0,1,1,1,1\n1,0,0,1,3,1,0.5,1\n");
  const Scene scene = s.scene("time = {}\n[[instances]]\nvolume = 0\nfile = \"at.csv\"\ndensity = 2\n", 1);
  ASSERT_EQ(scene.instances.size(), 2u);
  for (const InstanceSettings& entry : scene.instances) EXPECT_EQ(entry.name, "s");
  const InstanceList second = places_of(scene.instances[1], "");
  EXPECT_EQ(second.densities, std::vector{6.0});
  EXPECT_EQ(second.tints, std::vector{dvec3(1, 0.5, 1)});
  EXPECT_EQ(dvec3(second.matrices[0][3]), dvec3(1, 0, 0));
}

TEST(VolumeTime, TimeOffsetsNeedASequence) {
  const Sequence s({1, 2});
  const std::string place = "matrices = [[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]\n";
  EXPECT_TRUE(holds(s.error("[[instances]]\nvolume = 0\ntime_offset = 1\n" + place), "no sequence with a table time"));
  EXPECT_EQ(s.error("time = {}\n[[instances]]\nvolume = 0\ntime_offset = 1\n" + place), "");
}

TEST(VolumeTime, FieldsHaveFilesOfTheirOwn) {
  const Sequence s({1, 2});
  for (const char* name : {"t.0001.vdb", "t.0002.vdb", "fixed.vdb"}) test::write_file(s / name, name);
  const Scene scene =
      s.scene("temperature_file = \"t.####.vdb\"\nvelocity_file = \"fixed.vdb\"\ntime = {fps = 12, offset = 1}\n", 1);
  const VolumeSettings& v = scene.volumes[0];
  EXPECT_EQ(v.temperature_grid, "auto") << "a file of its own says that it is there";
  EXPECT_EQ(v.temperature_file.filename(), "t.0001.vdb");
  ASSERT_NE(v.moment.later, nullptr);
  EXPECT_EQ(v.moment.later->temperature_file.filename(), "t.0002.vdb");
  EXPECT_EQ(v.moment.later->velocity_file.filename(), "fixed.vdb");
  EXPECT_TRUE(holds(s.error("flame_file = \"no.vdb\"\n"), "'flame_file' of [[volumes]] is"));
  EXPECT_TRUE(holds(s.error("flame_file = \"fixed.vdb\"\nflame_grid = \"none\"\n"),
                    "'flame_file' stands beside flame_grid = \"none\""));
}

/// Two frames of a ball that moves by 0.4 along x, voxels of 0.1.
class MovingBall {
 public:
  MovingBall() {
    for (const int frame : {1, 2}) {
      const dvec3 centre(4.0 * (frame - 1), 0, 0);
      test::write_affine_vdb(folder_ / "ball.vdb", {ivec3(-12), ivec3(16)}, test::scaling(dvec3(0.1)),
                             [&](const ivec3& v) {
                               const dvec3 p = dvec3(v) - centre;
                               return static_cast<float>(std::exp(-glm::dot(p, p) / 16));
                             });
      test::write_velocity_vdb(folder_ / fmt::format("b.{}.vdb", frame), folder_ / "ball.vdb", {ivec3(-24), ivec3(28)},
                               dvec3(0.2, 0, 0));
    }
  }
  PreparedScene prepared(const std::string& keys, const std::string& camera = "") const {
    const Scene scene = parse_scene(
        std::string(kCamera) + camera + "[[volumes]]\nfile = \"b.#.vdb\"\n" + keys + "[environment]\nradiance = 1\n",
        folder_ / "scene.toml", std::vector<std::string>{"render.frame=1"});
    return PreparedScene(scene, {});
  }

 private:
  test::TemporaryFolder folder_;
};

bool told(const PreparedScene& scene, const std::string& part) {
  return std::any_of(scene.notes().begin(), scene.notes().end(),
                     [&](const std::string& note) { return holds(note, part); });
}

TEST(VolumeTime, AScenesMediumIsWhatIsBetween) {
  const MovingBall ball;
  const auto density = [](const PreparedScene& scene, const dvec3& p) {
    const Medium& medium = *scene.medium();
    return medium.density(medium.to_local(p - scene.world_shift()));
  };
  const std::string motion = "velocity_grid = \"auto\"\nvelocity_scale = 2\n";
  const PreparedScene moved = ball.prepared(motion + "time = {offset = 0.5}\n");
  EXPECT_NEAR(density(moved, dvec3(0.2, 0, 0)), 1, 0.01);
  EXPECT_NEAR(density(moved, dvec3(-0.2, 0, 0)), std::exp(-1), 0.01);
  EXPECT_FALSE(told(moved, "fades"));
  const PreparedScene mixed = ball.prepared("time = {offset = 0.5}\n");
  EXPECT_NEAR(density(mixed, dvec3(0.2, 0, 0)), std::exp(-0.25), 0.01);
  EXPECT_TRUE(told(mixed, "velocity_grid is none: what is between its frames is a mixture"));
  const PreparedScene wrong = ball.prepared("velocity_grid = \"auto\"\nvelocity_scale = -2\ntime = {offset = 0.5}\n");
  EXPECT_TRUE(told(wrong, "velocity_scale = -2 is not the file's unit per frame"));
  const PreparedScene whole = ball.prepared("time = {offset = 1}\n");
  EXPECT_NEAR(density(whole, dvec3(0.4, 0, 0)), 1, 1e-3);
}

TEST(VolumeTime, MotionBlurFollowsTheVolumesOwnSpeed) {
  const MovingBall ball;
  const std::string shutter = "shutter = [0, 1]\n", motion = "velocity_grid = \"auto\"\nvelocity_scale = 2\n";
  const auto displacement = [&](const std::string& time) {
    const PreparedScene scene = ball.prepared(motion + "time = {" + time + "}\n", shutter);
    const Displacement* const d = scene.medium()->displacement();
    return d ? std::pair(d->open, d->close) : std::pair(-9.0, -9.0);
  };
  EXPECT_EQ(displacement("frame = [[1, 1], [3, 2]]"), std::pair(0.0, 0.5));
  EXPECT_NEAR(displacement("frame = [[1, 1.25], [4, 1.75]]").second, 0.5 / 3, 1e-12) << "between frames, too";
  EXPECT_EQ(displacement("frame = [[1, 2], [3, 1]]"), std::pair(-0.0, -0.5)) << "backwards";
  EXPECT_EQ(displacement("offset = 9, beyond = \"hold\""), std::pair(-9.0, -9.0)) << "held: nothing moves";
  // The ball moves by 0.4 a frame of the volume: by 0.1 from 1.25 to 1.5.
  const PreparedScene between = ball.prepared(motion + "time = {frame = [[1, 1.25], [2, 1.5]]}\n", shutter);
  const Medium open = between.medium()->at_time(0), close = between.medium()->at_time(1);
  const auto at = [&](const Medium& m, double x) {
    return m.density(m.to_local(dvec3(x, 0, 0) - between.world_shift()));
  };
  EXPECT_NEAR(at(open, 0.1), 1, 0.01);
  EXPECT_NEAR(at(close, 0.2), 1, 0.01);
}

}  // namespace
}  // namespace brume
