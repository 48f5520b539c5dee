// Guides for frames that brume did not render: `brume guides`, `brume denoise --guides`, a scene out of Blender.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "image/exr_io.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::run_brume;

const std::string kSmoke = test::source("data/scenes/smoke.toml").string();
const std::string kSize = " -D film.width=72 -D film.height=64 -q ";

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

class ForeignGuides : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void run(const std::string& arguments) {
    const auto r = run_brume(arguments);
    ASSERT_EQ(r.status, 0) << arguments << "\n" << r.err;
  }
  Layers rendered(const std::string& name, const std::string& options) {
    run("render " + kSmoke + kSize + options + " -o " + path(name));
    return read_exr(folder_ / name);
  }
  std::string refused(const std::string& arguments) {
    const auto r = run_brume(arguments + " -o " + path("refused.exr"));
    EXPECT_EQ(r.status, 2) << arguments << "\n" << r.err;
    EXPECT_FALSE(std::filesystem::exists(folder_ / "refused.exr"));
    return r.err;
  }
  /// The render as Cycles would have written it: passes, no statistics, no camera.
  std::string as_cycles(const Layers& frame, const std::string& name) {
    test::ExrPart part{test::exr_header(frame.width(), frame.height()), {}};
    for (const char* pass : {"Combined", "VolumeDir", "VolumeInd"})
      test::add_channels(part.header, test::channels_of(std::string("View Layer.") + pass), Imf::FLOAT);
    part.value = [&](const std::string& channel, int x, int y) {
      const std::string c(1, channel.back());
      const auto at = [&](const std::string& layer) { return static_cast<double>(frame.at(layer + c)(x, y)); };
      if (holds(channel, "VolumeDir")) return at("direct.");
      return holds(channel, "VolumeInd") ? at("indirect.") : at("direct.") + at("indirect.");
    };
    test::write_exr_file(folder_ / name, {part});
    return path(name);
  }
  test::TemporaryFolder folder_;
};

TEST_F(ForeignGuides, AreThoseThatARenderOfTheSceneRecords) {
  const Layers own = rendered("own.exr", "--spp 2 --layers direct,guides");
  run("guides --like " + path("own.exr") + " --scene " + kSmoke + " -q -o " + path("guides.exr"));
  const Layers guides = read_exr(folder_ / "guides.exr");
  EXPECT_EQ(guides.text("sceneHash"), own.text("sceneHash"));
  EXPECT_GT(guides.channels().size(), 30u);
  for (const auto& [name, plane] : guides.channels()) {
    // The header's camera is in single precision.
    const Plane& theirs = own.at(name);
    double difference = 0, size = 0;
    for (int y = 0; y < plane.height(); ++y)
      for (int x = 0; x < plane.width(); ++x) {
        difference += std::abs(static_cast<double>(plane(x, y) - theirs(x, y)));
        size += std::abs(static_cast<double>(theirs(x, y)));
      }
    EXPECT_LE(difference, 2e-3 * size) << name;
  }
}

TEST_F(ForeignGuides, CleanAFrameOfAnotherRenderer) {
  const Layers truth = rendered("truth.exr", "--spp 1024 --seed 9 --layers none --no-statistics");
  const std::string noisy = as_cycles(rendered("noisy.exr", "--spp 8 --layers direct,indirect"), "cycles.exr");
  const std::string without = run_brume("guides --like " + noisy + " --volume " +
                                        test::source("data/volumes/smoke.vdb").string() + " -o " + path("no.exr"))
                                  .err;
  EXPECT_TRUE(holds(without, "no camera in its header")) << without;
  run("guides --like " + noisy + " --scene " + kSmoke + " --spp 8 -q -o " + path("guides.exr"));
  run("denoise " + noisy + " -o " + path("plain.exr"));
  run("denoise " + noisy + " --guides " + path("guides.exr") + " -o " + path("clean.exr"));
  const auto error = [&](const std::string& name) {
    const Layers frame = read_exr(folder_ / name);
    double sum = 0;
    for (const char c : {'R', 'G', 'B'})
      for (int y = 0; y < frame.height(); ++y)
        for (int x = 0; x < frame.width(); ++x)
          sum += std::pow(static_cast<double>(frame.at(std::string("View Layer.Combined.") + c)(x, y) -
                                              truth.at(std::string(1, c))(x, y)),
                          2);
    return std::sqrt(sum);
  };
  EXPECT_LT(error("plain.exr"), error("cycles.exr"));
  EXPECT_LT(error("clean.exr"), 0.6 * error("plain.exr"));
  const Layers clean = read_exr(folder_ / "clean.exr");
  for (const char c : {'R', 'G', 'B'}) {
    const auto of = [&](const std::string& pass) -> const Plane& { return clean.at("View Layer." + pass + "." + c); };
    for (int y = 0; y < clean.height(); ++y)
      for (int x = 0; x < clean.width(); ++x)
        ASSERT_EQ(of("Combined")(x, y), of("VolumeDir")(x, y) + of("VolumeInd")(x, y));
  }
}

TEST_F(ForeignGuides, OfAnotherPictureAreRefused) {
  rendered("frame.exr", "--spp 2 --layers direct,indirect");
  const std::string denoise = "denoise " + path("frame.exr") + " --guides ";
  const std::string guides = "guides --like " + path("frame.exr") + " --scene " + kSmoke + " -q ";
  EXPECT_TRUE(holds(refused(denoise + path("frame.exr")), "no channel guide.*"));

  run("render " + kSmoke + " -D film.width=40 -D film.height=40 --spp 1 --layers guides -q -o " + path("small.exr"));
  EXPECT_TRUE(holds(refused(denoise + path("small.exr")), "guides of a picture of"));

  run("render " + kSmoke + kSize + "-D camera.fov=30 --spp 1 --layers guides -o " + path("camera.exr"));
  EXPECT_TRUE(holds(refused(denoise + path("camera.exr")), "another camera saw these guides"));

  run(guides + " -o " + path("right.exr"));
  run(denoise + path("right.exr") + " -q -o " + path("clean.exr"));
  EXPECT_EQ(read_exr(folder_ / "clean.exr").text("filter"), "transport_regression");

  run(guides + "-D volumes.0.sigma_t=9 -o " + path("scene.exr"));
  EXPECT_TRUE(holds(refused(denoise + path("scene.exr")), "guides of another scene"));

  EXPECT_TRUE(holds(refused("guides --like " + path("frame.exr")), "neither --volume nor --scene"));
  test::write_deep_exr(folder_ / "deep.exr");
  EXPECT_TRUE(holds(refused("guides --like " + path("deep.exr") + " --scene " + kSmoke), "holds deep pixels"));
  EXPECT_TRUE(holds(refused("guides --like " + path("missing.exr") + " --scene " + kSmoke), "no such file"));
}

TEST_F(ForeignGuides, OfAnotherSceneAreSaidToBeAndLeftOut) {
  const std::string cloud = test::source("data/scenes/cloud.toml").string();
  const std::string noisy = as_cycles(rendered("noisy.exr", "--spp 16 --layers direct,indirect"), "cycles.exr");
  run("guides --like " + noisy + " --scene " + kSmoke + " --spp 16 -q -o " + path("right.exr"));
  run("guides --like " + noisy + " --scene " + cloud + " --spp 16 -q -o " + path("wrong.exr"));
  const Layers right = read_exr(folder_ / "right.exr"), wrong = read_exr(folder_ / "wrong.exr");
  EXPECT_EQ(right.text("guidesOf"), "cycles.exr");
  EXPECT_NE(right.text("guidesFingerprint"), wrong.text("guidesFingerprint"));
  run("denoise " + noisy + " -q -o " + path("none.exr"));
  const auto denoised = [&](const std::string& guides) {
    const auto r = run_brume("denoise " + noisy + " --guides " + path(guides) + " -o " + path("clean.exr"));
    EXPECT_EQ(r.status, 0) << r.err;
    return r.err;
  };
  const std::string said = denoised("wrong.exr");
  EXPECT_TRUE(holds(said, "wrong.exr explains the frame worse than its own features do")) << said;
  test::expect_same_bits(read_exr(folder_ / "none.exr"), read_exr(folder_ / "clean.exr"), "without guides");
  EXPECT_FALSE(holds(denoised("right.exr"), "explains the frame worse"));
  EXPECT_EQ(read_exr(folder_ / "clean.exr").text("brume.filter"), "transport_regression");
}

TEST_F(ForeignGuides, OfASequenceAreMadeFrameByFrameAndOptionalBesideIt) {
  for (const char* number : {"0000", "0001", "0002"})
    as_cycles(rendered("noisy.exr", std::string("--spp 4 --layers direct,indirect --seed ") + number),
              std::string("shot.") + number + ".exr");
  const std::string frames = " '" + path("shot.####.exr") + "' ", guides = " '" + path("g.####.exr") + "' ";
  const auto r = run_brume("guides --like" + frames + "--scene " + kSmoke + " --frames 0-1 -q -o" + guides);
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_EQ(r.out, path("g.0000.exr") + "\n" + path("g.0001.exr") + "\n");
  EXPECT_TRUE(
      holds(refused("guides --like" + frames + "--scene " + kSmoke + " --frames 0-1"), "would go into one file"));
  const auto clean =
      run_brume("denoise" + frames + "--guides" + guides + "--frames 0-1 -o '" + path("c.####.exr") + "'");
  EXPECT_EQ(clean.status, 0) << clean.err;
  EXPECT_TRUE(holds(clean.err, "of the frames beside it, g.0002.exr for shot.0002.exr")) << clean.err;
  EXPECT_FALSE(holds(clean.err, " -1,")) << "there is no frame before the first: " << clean.err;
  EXPECT_EQ(read_exr(folder_ / "c.0001.exr").text("brume.filterFrames"), "-1");
  // A frame beside it that cannot be read is left out, too.
  test::write_file(folder_ / "g.0001.exr", "damaged");
  const auto damaged =
      run_brume("denoise" + frames + "--guides" + guides + "--frames 0 -o '" + path("d.####.exr") + "'");
  EXPECT_EQ(damaged.status, 0) << damaged.err;
  EXPECT_TRUE(holds(damaged.err, "left out beside")) << damaged.err;
}

TEST_F(ForeignGuides, ASceneOutOfBlenderIsOneThatBrumeReads) {
  if (std::system("command -v blender >/dev/null") != 0) GTEST_SKIP() << "blender is not there";
  const std::string command =
      "blender -b --factory-startup --python " + test::source("tests/data/blender_scene.py").string() + " -- " +
      test::source("apps/blender/blender_export.py").string() + " " + test::source("data/volumes/smoke.vdb").string() +
      " " + path("out.toml") + " >" + path("log.txt") + " 2>&1";
  ASSERT_EQ(std::system(command.c_str()), 0);
  ASSERT_TRUE(std::filesystem::exists(folder_ / "out.toml")) << test::read_file(folder_ / "log.txt");
  const std::string scene = test::read_file(folder_ / "out.toml");
  for (const char* line : {"position = [0, -7, 1.5]",
                           "fov = 26.",
                           "width = 64",
                           "type = \"sun\"",
                           "irradiance = [6, 6, 6]",
                           "type = \"point\"",
                           "type = \"rectangle\"",
                           "grid = \"density_noise\"",
                           "sigma_s = [9, 9, 9]",
                           "sigma_a = [2.63603897",  // 9 (1 - sqrt(0.5)): Principled Volume's absorption colour
                           "index_offset = [0.5, 0.5, 0.5]",
                           "sigma_s = [3.75, 3.75, 3.75]",  // an attribute halved, times the 15 of a Value node
                           "intensity = [1.5915494, 1.5",   // 10 W times the 2 of the light's Emission node
                           "file = \"out_files/Cube_0.ply\"",
                           "pixel_aspect = 2",
                           "Fog_001_baked_",  // of two objects that share a mesh, named by the first in Blender's order
                           "grid = \"baked_0\"",  // its density is that of a texture
                           "[[instances]]\nvolume = 2\nfile = \"out_files/places.ply\"",
                           "# Left out: Procedural: the volume is left out: no grid of its file drives its density",
                           "# Left out: Render border"})
    EXPECT_TRUE(holds(scene, line)) << line << "\n" << scene;
  EXPECT_FALSE(holds(scene, "Point: ")) << "nothing of it is left out";
  run("render " + path("out.toml") + " --spp 1 -q -o " + path("out.exr"));
}

}  // namespace
}  // namespace brume
