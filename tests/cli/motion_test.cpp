// The layers motion.previous and motion.next: closed forms of where thin slabs, velocities and surfaces go.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "image/exr_io.h"
#include "tests/support/command_folder.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::run_brume;

constexpr double kWidth = 48, kHeight = 40;
const std::string kTiny = " -D film.width=48 -D film.height=40 --spp 1 --layers motion -q ";

class Motion : public test::CommandFolder {
 protected:
  Layers rendered(const std::string& arguments, std::string* said = nullptr) {
    const auto r = run_brume("render " + arguments + kTiny + "-o " + path("f.exr"));
    EXPECT_EQ(r.status, 0) << r.err;
    if (said) *said = r.err;
    return read_exr(path("f.exr"));
  }
  static std::array<double, 4> at(const Layers& frame, const ivec2& pixel) {
    std::array<double, 4> motion;
    const char* const names[] = {"motion.previous.X", "motion.previous.Y", "motion.next.X", "motion.next.Y"};
    for (size_t i = 0; i < 4; ++i) motion[i] = frame.at(names[i])(pixel.x, pixel.y);
    return motion;
  }
  static void expect_motion(const Layers& frame, const ivec2& pixel, const std::array<double, 4>& expected,
                            double tolerance = 2e-3) {
    const std::array<double, 4> found = at(frame, pixel);
    for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(found[i], expected[i], tolerance) << "number " << i;
  }
};

/// Looks along y, z up, from 5 away; a film whose half width is at tan = 0.5.
const std::string kCamera =
    "name = \"m\"\n[camera]\nfov_axis = \"x\"\nfov = 53.13010235415598\nposition = [0, -5, 0]\nlook_at = [0, 0, 0]\nup = [0, 0, 1]\n";
constexpr double kPixelsPerTangent = kWidth / 2 / 0.5;
const std::string kSlab =
    "[environment]\nradiance = 0.5\n[[volumes]]\nshape = \"box\"\nlo = [-1, -0.001, -1]\nhi = [1, 0.001, 1]\nsigma_t = 200.0\n";

TEST_F(Motion, OfAMovingCameraIsThatOfPointsAtTheirDepth) {
  // It goes to the right by .5 a frame: what is 5 away moves to the left, the sky stays.
  std::string keys = kCamera;
  keys.replace(
      keys.find("position"), std::string::npos,
      "up = [0, 0, 1]\nkeys = [[0, -0.5, -5, 0, -0.5, 0, 0], [1, 0, -5, 0, 0, 0, 0], [2, 0.5, -5, 0, 0.5, 0, 0]]\n");
  test::write_file(folder_ / "keys.toml", keys + kSlab);
  const Layers frame = rendered(path("keys.toml") + " -D render.frame=1");
  const double moved = 0.5 / 5 * kPixelsPerTangent;
  expect_motion(frame, {24, 20}, {moved, 0, -moved, 0});
  expect_motion(frame, {15, 12}, {moved, 0, -moved, 0});
  expect_motion(frame, {2, 2}, {0, 0, 0, 0});  // beside the slab
  expect_motion(rendered(path("keys.toml") + " -D render.frame=7"), {24, 20}, {0, 0, 0, 0}, 0);
}

TEST_F(Motion, FollowsVelocitiesByWhatTheyCover) {
  const VoxelBox box{ivec3(0), ivec3(15)};
  test::write_grids_vdb(folder_ / "still.vdb", box, {{"density", [](const ivec3&) { return 1.0f; }}}, 0.1);
  test::write_velocity_vdb(folder_ / "smoke.vdb", folder_ / "still.vdb", box, dvec3(4, 0, 2));
  const std::string volume =
      "[[volumes]]\nfile = \"smoke.vdb\"\ngrid = \"density\"\nsigma_t = 40.0\nvelocity_grid = \"vel\"\nvelocity_scale = 0.05\n"
      "object_to_world = [[1, 0, 0, -0.75], [0, 1, 0, 0], [0, 0, 1, -0.75], [0, 0, 0, 1]]\n";
  test::write_file(folder_ / "v.toml", kCamera + "[environment]\nradiance = 0.5\n" + volume);
  const Layers frame = rendered(path("v.toml"));
  // By .2 to the right and .1 upwards, which is towards lower rows; nearly all is seen within 1 / 40 of the front.
  const double scale = kPixelsPerTangent / 5, tolerance = 0.03;
  expect_motion(frame, {24, 20}, {-0.2 * scale, 0.1 * scale, 0.2 * scale, -0.1 * scale}, tolerance);
  // A still slab in front of it that takes half of what is seen halves the mean.
  test::write_file(folder_ / "two.toml",
                   kCamera + kSlab.substr(0, kSlab.find("lo =")) +
                       "lo = [-1, -0.201, -1]\nhi = [1, -0.199, 1]\nsigma_t = 346.5735902799727\n" + volume);
  expect_motion(rendered(path("two.toml")), {24, 20}, {-0.1 * scale, 0.05 * scale, 0.1 * scale, -0.05 * scale},
                tolerance);
}

TEST_F(Motion, OfASequenceOfScenesIsThatOfItsObjects) {
  test::write_file(folder_ / "quad.obj", "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 1 2 3 4\n");
  for (int frame = 1; frame <= 3; ++frame) {
    const std::string up = fmt::format("object_to_world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, {}], [0, 0, 0, 1]]\n",
                                       0.25 * (frame - 2));
    test::write_file(folder_ / fmt::format("s.{}.toml", frame),
                     kCamera + "[environment]\nradiance = 0.5\n[[surfaces]]\nfile = \"quad.obj\"\n" + up);
    test::write_file(folder_ / fmt::format("v.{}.toml", frame), kCamera + kSlab + up);
  }
  const double moved = 0.25 / 5 * kPixelsPerTangent;
  for (const std::string name : {"s", "v"}) {
    SCOPED_TRACE(name);
    std::string said;
    const Layers frame = rendered(path(name + ".#.toml") + " --frames 2");
    expect_motion(frame, {24, 20}, {0, moved, 0, -moved});
    expect_motion(frame, {2, 2}, {0, 0, 0, 0});
    expect_motion(rendered(path(name + ".#.toml") + " --frames 3", &said), {24, 20}, {0, moved, 0, 0});
    EXPECT_NE(said.find("the layer motion: camera and objects stand still towards frame 4"), std::string::npos) << said;
  }
}

}  // namespace
}  // namespace brume
