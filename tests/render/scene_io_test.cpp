#include "render/scene/scene_io.h"

#include <gtest/gtest.h>

#include "base/error.h"
#include "render/scene/scene_reference.h"
#include "tests/support/files.h"

namespace brume {
namespace {

const char* const kCamera = "[camera]\nposition = [0, -5, 0]\nlook_at = [0, 0, 0]\n";

std::string error_of(const std::string& text, const std::vector<std::string>& overrides = {}) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "s.toml", text);
  try {
    read_scene(folder / "s.toml", overrides);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(ReadScene, ReadsTheDemoScenes) {
  const Scene cloud = read_scene(test::source("data/scenes/cloud.toml"));
  EXPECT_EQ(cloud.name, "cloud");
  EXPECT_GE(cloud.volumes[0].albedo.x, 0.99);
  EXPECT_GE(cloud.volumes[0].g, 0.6);
  EXPECT_EQ(cloud.film.width, 400);
  const Scene smoke = read_scene(test::source("data/scenes/smoke.toml"));
  EXPECT_EQ(smoke.volumes[0].object_to_world[3], glm::dvec4(-1, -1, 0, 1)) << "rows first, points are columns";
  EXPECT_EQ(smoke.lights.size(), 1u);
}

TEST(ReadScene, ErrorsUnderlineTheLineAndSayWhatIsExpected) {
  const std::string unknown = error_of(std::string(kCamera) + "fovv = 30\n");
  EXPECT_TRUE(holds(unknown, "unknown key 'fovv' in [camera]; did you mean 'fov'?")) << unknown;
  EXPECT_TRUE(holds(unknown, "s.toml") && holds(unknown, "4 | fovv = 30"));
  EXPECT_TRUE(holds(unknown, "~~") || holds(unknown, "^^")) << "toml11 3 and 4 underline each in its way: " << unknown;
  const std::string missing = error_of("[camera]\nposition = [0, 0, 1]\n");
  EXPECT_TRUE(holds(missing, "[camera] has no 'look_at'") && holds(missing, "add look_at")) << missing;
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "fov = \"wide\"\n"), "'fov' is text"))
      << error_of(std::string(kCamera) + "fov = \"wide\"\n");
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "fov = 200\n"), "'fov' is out of range"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "fov = nan\n"), "'fov' is out of range"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "up = [1, 2]\n"), "'up' is an array of 2"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "fov_axis = \"shorte\"\n"), "did you mean 'shorter'?"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "[film]\nwidth = 12.5\n"), "'width' is a number"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "[cameras]\n"), "unknown key 'cameras'; did you mean 'camera'?"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "[[volumes]]\nsigma_t = 1\n"), "[[volumes]] has no 'file'"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "[[lights]]\ntype = \"sun\"\nirradiance = 1\n"),
                    "a sun light has no 'direction'"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "[[lights]]\ntype = \"spt\"\n"), "'type' cannot be 'spt'"));
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "fov =\n"), "4 | fov ="))
      << "a missing value: " << error_of(std::string(kCamera) + "fov =\n");
  EXPECT_TRUE(holds(error_of("[camera\n"), "s.toml")) << "syntax errors name the file too";
  for (const char* text : {"up = [0, 1 # up\n0]\n", "up = [0, # up\n\n  # and on\n1 2]\n", "up = {x = 0 # up\n}\n",
                           "up = [0, \"1\n# up\n", "# \x01\nfov = 30\n# the end"})
    EXPECT_TRUE(holds(error_of(text), "s.toml")) << "comments in what is no TOML: " << text;
  EXPECT_TRUE(holds(error_of("name = \"x\"\n"), "has no [camera]"));
  const auto volume = [](const std::string& keys) {
    return error_of(std::string(kCamera) + "[[volumes]]\nfile = \"a\"\n" + keys);
  };
  EXPECT_TRUE(holds(volume("sigma_t = 1\nsigma_a = 1\n"), "'sigma_t' stands beside sigma_a and sigma_s"));
  EXPECT_TRUE(holds(volume("preset = \"principled\"\nsigma_t = 1\n"), "'sigma_t' stands beside preset"));
  EXPECT_TRUE(holds(volume("preset = \"principled\"\nscatter = 1\n"), "'scatter' is no parameter of preset"));
  EXPECT_TRUE(holds(volume("scatter = 1\n"), "'scatter' belongs to a preset"));
  EXPECT_TRUE(holds(volume("shape = \"box\"\n"), "'file' stands beside shape"));
  EXPECT_TRUE(holds(volume("remap = [[0, 0]]\n"), "'remap' has one row"));
  EXPECT_TRUE(holds(volume("remap = [[0, 0], [0, 1]]\n"), "'remap' does not rise"));
  EXPECT_TRUE(holds(volume("flame_ramp = [[0, 0], [1, 1]]\n"), "a row that is not 4 numbers"));
  EXPECT_TRUE(holds(volume("droplet_diameter = 10\n"), "'droplet_diameter' has no meaning for phase"));
  const auto surface = [](const std::string& keys) {
    return error_of(std::string(kCamera) + "[[surfaces]]\nfile = \"a.ply\"\n" + keys);
  };
  EXPECT_TRUE(holds(surface("edge_albedo = 0.5\n"), "'edge_albedo' has no meaning for a diffuse surface"));
  EXPECT_TRUE(holds(surface("material = \"conductor\"\nreflection_tint = 0.5\n"),
                    "'reflection_tint' has no meaning for a conductor surface"));
  EXPECT_TRUE(holds(surface("two_sided = true\n"), "'two_sided' has no meaning without 'radiance'"));
  EXPECT_TRUE(holds(surface("radiance = 1\nobject_to_world_end = [[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"),
                    "a surface that emits cannot move"));
  EXPECT_TRUE(
      holds(error_of("[camera]\nfrom_exr = \"a.exr\"\nshift = [0.1, 0]\n"), "'shift' stands beside 'from_exr'"));
  const auto sky = [](const std::string& keys) {
    return error_of(std::string(kCamera) + "[environment]\nsky = \"preetham\"\n" + keys);
  };
  EXPECT_TRUE(holds(sky("sun_direction = [0, 0, -1]\n"), "'sun_direction' lies below the horizon"));
  EXPECT_TRUE(holds(sky("sun_direction = [0, 0, 0]\n"), "'sun_direction' lies below the horizon"));
  EXPECT_TRUE(holds(sky("up = [0, 0, 0]\n"), "'up' is zero"));
  EXPECT_TRUE(holds(sky("file = \"a.hdr\"\n"), "'file' stands beside 'sky'"));
}

TEST(ReadScene, OverridesReachEveryKey) {
  const std::vector<std::string> overrides = {"camera.fov=12.5", "volumes.0.sigma_t=7", "name=other",
                                              "render.light_sampling=all"};
  const Scene scene = read_scene(test::source("data/scenes/cloud.toml"), overrides);
  EXPECT_EQ(scene.camera.fov, 12.5);
  EXPECT_EQ(scene.volumes[0].sigma_t, dvec3(7));
  EXPECT_EQ(scene.name, "other");
  EXPECT_EQ(scene.render.light_sampling, "all");
  EXPECT_TRUE(holds(error_of(kCamera, {"camera.fovv=3"}), "unknown key 'fovv'"));
  EXPECT_TRUE(holds(error_of(kCamera, {"camera.fov"}), "expected -D table.key=value"));
  for (const std::string made : {"output.width=64", "lights.0.radius=1"})
    EXPECT_TRUE(holds(error_of(kCamera, {made}), ("--> -D " + made).c_str())) << error_of(kCamera, {made});
  EXPECT_TRUE(holds(error_of(kCamera, {"camera.fov=.5"}), "-D camera.fov=.5")) << "where it was found";
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "[[volumes]]\nfile=\"a\"\n", {"volumes.3.g=0"}),
                    "not one of the 1 entries"));
}

TEST(ReadScene, TheHashFollowsWhatDecidesThePicture) {
  const auto hash = [](std::vector<std::string> overrides) {
    return read_scene(test::source("data/scenes/cloud.toml"), overrides).hash;
  };
  EXPECT_EQ(hash({}), hash({"render.spp=3", "render.seed=9"}));
  EXPECT_NE(hash({}), hash({"camera.fov=12"}));
  EXPECT_NE(hash({}), hash({"volumes.0.g=0.1"}));
}

TEST(ReadScene, NamesOfFilesHoldTheFrame) {
  const test::TemporaryFolder folder;
  for (const char* name : {"s.0007.vdb", "take#2.vdb", "s.####.exr"}) test::write_file(folder / name, name);
  const auto files = [&](const std::string& file, const std::string& frame) {
    return parse_scene(std::string(kCamera) + "[[volumes]]\nfile = \"" + file + "\"\n", folder / "s.toml",
                       std::vector<std::string>{"render.frame=" + frame})
        .volumes[0]
        .file.filename()
        .string();
  };
  EXPECT_EQ(files("s.####.vdb", "7"), "s.0007.vdb");
  EXPECT_EQ(files("s.$F4.vdb", "7"), "s.0007.vdb");
  EXPECT_EQ(files("take#2.vdb", "7"), "take#2.vdb") << "a file of that very name";
  EXPECT_TRUE(holds(error_of(std::string(kCamera) + "[[volumes]]\nfile = \"s.####.vdb\"\n", {"render.frame=12"}),
                    "s.0012.vdb: no such file"));
}

TEST(ReadScene, CameraKeysMoveTheCameraFromFrameToFrame) {
  const auto camera = [](const std::string& keys, double frame, const std::string& more = "") {
    return parse_scene("[camera]\nkeys = " + keys + "\n" + more, "s.toml",
                       std::vector<std::string>{"render.frame=" + std::to_string(static_cast<int>(frame))})
        .camera;
  };
  const std::string two = "[[10, 0,-5,1, 0,0,0], [20, 10,-5,1, 0,2,0]]";
  EXPECT_EQ(camera(two, 1).position, dvec3(0, -5, 1)) << "at rest before the first";
  EXPECT_EQ(camera(two, 99).position, dvec3(10, -5, 1)) << "and after the last";
  EXPECT_NEAR(camera(two, 13).position.x, 3, 1e-12) << "straight between two";
  EXPECT_NEAR(camera(two, 13).look_at.y, 0.6, 1e-12);
  // Keys on a parabola, which the curve follows where tangents have both neighbours.
  const std::string four = "[[0, 0,-5,1, 0,0,0], [2, 4,-5,1, 0,0,0], [4, 16,-5,1, 0,0,0], [6, 36,-5,1, 0,0,0]]";
  EXPECT_NEAR(camera(four, 2).position.x, 4, 1e-12);
  EXPECT_NEAR(camera(four, 3).position.x, 9, 1e-12);
  // It moves over the shutter as it does over the frames, and where it rests it does not.
  const CameraSettings blurred = camera(two, 13, "shutter = [-0.5, 0.5]\n");
  EXPECT_NEAR(blurred.position.x, 2.5, 1e-12);
  ASSERT_EQ(blurred.position_end.size(), 3u);
  EXPECT_NEAR(blurred.position_end[0], 3.5, 1e-12);
  EXPECT_TRUE(camera(two, 30, "shutter = [-0.5, 0.5]\n").position_end.empty());
  EXPECT_TRUE(holds(error_of("[camera]\nkeys = " + two + "\nposition = [0,0,0]\n"), "'position' stands beside 'keys'"));
  EXPECT_TRUE(holds(error_of("[camera]\nkeys = [[1, 0,-5,1, 0,0], [2, 0,0,0, 0,0]]\n"), "a row that is not 7 numbers"));
  // A frame's fingerprint follows its own camera, not keys that lie elsewhere.
  const auto hash = [&](const std::string& keys) {
    return parse_scene("[camera]\nkeys = " + keys, "s.toml", std::vector<std::string>{"render.frame=1"}).hash;
  };
  EXPECT_EQ(hash(two), hash("[[10, 0,-5,1, 0,0,0], [20, 11,-5,1, 0,2,0]]"));
}

TEST(SceneReference, DocsAreInStep) {
  EXPECT_EQ(test::read_file(test::source("docs/scene.md")), scene_reference())
      << "run: brume docs scene > docs/scene.md";
}

}  // namespace
}  // namespace brume
