// Deep pictures from the command line: they flatten to the frame, and say where it lies.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "image/deep_picture.h"
#include "image/exr_deep.h"
#include "image/exr_io.h"
#include "tests/support/command_folder.h"

namespace brume {
namespace {

using test::holds;
using test::run_brume;

const std::string kTiny = " -D film.width=48 -D film.height=40 --spp 4 -q ";

class Deep : public test::CommandFolder {
 protected:
  std::string scene(const std::string& name) const { return test::source("bench/scenes/" + name + ".toml").string(); }
  void expect_alike(const Layers& a, const Layers& b, float most) {
    for (const char* name : {"R", "G", "B", "A"})
      for (int y = 0; y < a.height(); ++y)
        for (int x = 0; x < a.width(); ++x)
          ASSERT_NEAR(a.at(name)(x, y), b.at(name)(x, y), most * (1 + std::abs(a.at(name)(x, y))))
              << name << " " << x << " " << y;
  }
};

TEST_F(Deep, FlattenedIsTheFrame) {
  for (const std::string name :
       {"general/two_volumes", "general/floor_and_balls", "general/fire_room", "coloured_smoke", "general/lens"}) {
    SCOPED_TRACE(name);
    run("render " + scene(name) + kTiny + "--clean -o " + path("f.exr") + " --deep " + path("d.exr"));
    run("flatten " + path("d.exr") + " -q -o " + path("flat.exr"));
    const Layers frame = read_exr(path("f.exr"));
    expect_alike(frame, read_exr(path("flat.exr")), 1e-3f);
    const DeepPicture deep = read_deep_exr(path("d.exr"));
    EXPECT_LE(deep.most_samples(), 17u);  // and the sky
    if (std::system(("oiiotool " + path("d.exr") + " --flatten -o " + path("other.exr") + " 2>/dev/null").c_str()) == 0)
      expect_alike(frame, read_exr(path("other.exr")), 1e-3f);
    const std::vector<float>&z = deep.find("Z")->values, &back = deep.find("ZBack")->values;
    for (size_t p = 0; p + 1 < deep.begin.size(); ++p)
      for (size_t i = deep.begin[p]; i < deep.begin[p + 1]; ++i) {
        ASSERT_LE(z[i], back[i]);
        ASSERT_LE(i > deep.begin[p] ? back[i - 1] : z[i], z[i]);  // tidy
      }
  }
}

TEST_F(Deep, MoreSamplesChangeWhatLiesInFrontOfADepthByLittle) {
  const std::string render =
      "render " + test::source("data/scenes/smoke.toml").string() + kTiny + "--clean -o " + path("f.exr");
  run(render + " --deep " + path("few.exr"));
  run(render + " --deep " + path("many.exr") + " --deep-samples 4096 --deep-float");
  const DeepPicture few = read_deep_exr(path("few.exr")), many = read_deep_exr(path("many.exr"));
  double sum = 0, most = 0;
  for (int k = 0; k < 16; ++k) {
    const float before = 6.0f + 0.1f * static_cast<float>(k);
    const Layers a = flattened(few, before), b = flattened(many, before);
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x) {
        const double error = std::abs(static_cast<double>(a.at("A")(x, y)) - b.at("A")(x, y));
        sum += error / (16.0 * a.width() * a.height());
        most = std::max(most, error);
      }
  }
  EXPECT_LT(sum, 5e-4);
  EXPECT_LT(most, 2e-2);
}

TEST_F(Deep, OfSurfacesAloneHasThem) {
  const std::string text = fmt::format(
      "name = \"ball\"\n[camera]\nposition = [0, -5, 1]\nlook_at = [0, 0, 0.5]\n[environment]\nradiance = 0.5\n"
      "[[surfaces]]\nfile = \"{}\"\n",
      test::source("data/meshes/ball.obj").string());
  test::write_file(folder_ / "ball.toml", text);
  run("render " + path("ball.toml") + kTiny + "-o " + path("f.exr") + " --deep " + path("d.exr"));
  run("flatten " + path("d.exr") + " -q -o " + path("flat.exr"));
  const Layers frame = read_exr(path("f.exr"));
  EXPECT_FALSE(frame.find("guide.opacity.Y"));
  expect_alike(frame, read_exr(path("flat.exr")), 1e-3f);
  EXPECT_EQ(frame.at("A")(24, 20), 1);
  EXPECT_EQ(frame.at("A")(0, 0), 0);
}

TEST_F(Deep, FramesNameTheirFilesAndInfoTellsThem) {
  const std::string smoke = test::source("data/scenes/smoke.toml").string();
  run("render " + smoke + kTiny + "--frames 1-2 -o " + path("f.##.exr") + " --deep " + path("d.##.exr"));
  EXPECT_TRUE(std::filesystem::exists(path("d.02.exr")));
  const auto info = run_brume("info " + path("d.01.exr"));
  EXPECT_TRUE(holds(info.out, "in a pixel, ")) << info.out;
  EXPECT_TRUE(holds(info.out, "depths ")) << info.out;
  EXPECT_TRUE(
      holds(refused("render " + smoke + kTiny + "--frames 1-2 -o " + path("f.##.exr") + " --deep " + path("d.exr")),
            "--deep"));
  EXPECT_TRUE(holds(refused("render " + smoke + kTiny + "-o " + path("f.exr") + " --deep " + path("f.exr")), "--deep"));
  EXPECT_TRUE(holds(refused("picture " + path("d.01.exr") + " -o " + path("a.png")), "brume flatten"));
  EXPECT_TRUE(holds(refused("flatten " + path("f.01.exr") + " -o " + path("x.exr")), "has no deep pixels"));
}

TEST_F(Deep, DenoisedKeepsItsDepthsAndAlphas) {
  const std::string smoke = test::source("data/scenes/smoke.toml").string();
  run("render " + smoke + kTiny + "-o " + path("f.exr") + " --deep " + path("d.exr") + " --deep-float");
  run("denoise " + path("d.exr") + " -q -o " + path("clean.exr") + " --png " + path("clean.png"));
  const DeepPicture before = read_deep_exr(path("d.exr")), after = read_deep_exr(path("clean.exr"));
  EXPECT_EQ(after.begin, before.begin);
  for (const char* name : {"Z", "ZBack", "A"}) EXPECT_EQ(after.find(name)->values, before.find(name)->values) << name;
  EXPECT_NE(after.find("R")->values, before.find("R")->values);
  EXPECT_TRUE(holds(refused("denoise " + path("d.exr") + " --suffix _clean -o " + path("x.exr")), "holds deep pixels"));
}

TEST_F(Deep, DepthsOfWhatIsSeen) {
  const std::string text =
      "name = \"box\"\n[camera]\ntype = \"orthographic\"\nwidth = 0.8\nposition = [0, -5, 0]\nlook_at = [0, 0, 0]\n"
      "[environment]\nradiance = 0.5\n[render]\nmist_start = 4\nmist_depth = 2\nmist_falloff = \"linear\"\n"
      "[[volumes]]\nshape = \"box\"\nsigma_t = 2.0\n";
  test::write_file(folder_ / "box.toml", text);
  run("render " + path("box.toml") + kTiny + "--layers depths -o " + path("f.exr") + " --deep " + path("d.exr"));
  const Layers frame = read_exr(path("f.exr"));
  // Opacity 1 - e^-2 from 4.5 to 5.5.
  const double alpha = -std::expm1(-2.0), mean = 4.5 + 0.5 - std::exp(-2.0) / alpha;
  const ivec2 middle(24, 20);
  EXPECT_NEAR(frame.at("A")(middle.x, middle.y), alpha, 1e-4);
  EXPECT_NEAR(frame.at("depth_mean.Z")(middle.x, middle.y), mean, 2e-3);
  EXPECT_NEAR(frame.at("depth_half.Z")(middle.x, middle.y), 4.5 - std::log1p(-0.5 * alpha) / 2, 2e-3);
  EXPECT_NEAR(frame.at("depth_first.Z")(middle.x, middle.y), 4.5 - std::log1p(-0.01 * alpha) / 2, 2e-3);
  EXPECT_NEAR(frame.at("mist.Y")(middle.x, middle.y), 1 - alpha + alpha * (mean - 4) / 2, 3e-3);
  EXPECT_FALSE(frame.find("guide.opacity.Y"));
  const DeepPicture deep = read_deep_exr(path("d.exr"));
  const Layers front = flattened(deep, 4.8f);
  EXPECT_NEAR(front.at("A")(middle.x, middle.y), -std::expm1(-0.6), 1e-3);
}

// Light from infinitely far covers nothing, whatever the sum that rounding leaves of what does.
TEST_F(Deep, DepthsLieWhereTheMediumDoes) {
  run("render " + test::source("data/scenes/smoke.toml").string() + kTiny + "--layers depths -o " + path("f.exr") +
      " --deep " + path("d.exr"));
  const Layers frame = read_exr(path("f.exr"));
  float nearest = 1e10f, farthest = 0;
  const DeepPicture deep = read_deep_exr(path("d.exr"));
  for (const float z : deep.find("Z")->values) nearest = std::min(nearest, z);
  for (const float z : deep.find("ZBack")->values) farthest = std::max(farthest, z < 1e10f ? z : 0);
  size_t covered = 0;
  for (const char* name : {"depth_mean.Z", "depth_half.Z", "depth_first.Z"})
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const float z = frame.at(name)(x, y);
        if (z == 1e10f) continue;
        ++covered;
        ASSERT_TRUE(z >= nearest && z <= farthest) << name << " is " << z << " at " << x << " " << y;
      }
  EXPECT_GT(covered, 300u);
}

TEST_F(Deep, MistGrowsWithTheDistanceFromAPerspectiveCamera) {
  // A wall 5 away, whose corners are farther from the eye; half the film's width is at tan = 0.5.
  test::write_file(folder_ / "wall.obj", "v -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\nf 1 2 3 4\n");
  test::write_file(
      folder_ / "wall.toml",
      "name = \"wall\"\n[camera]\nfov_axis = \"x\"\nfov = 53.13010235415598\nposition = [0, -5, 0]\n"
      "look_at = [0, 0, 0]\nup = [0, 0, 1]\n[environment]\nradiance = 0.5\n[[surfaces]]\nfile = \"wall.obj\"\n"
      "[render]\nmist_start = 4\nmist_depth = 4\nmist_falloff = \"linear\"\n");
  run("render " + path("wall.toml") + kTiny + "--layers depths -o " + path("f.exr") + " --crop 6,4,48,40");
  const Layers frame = read_exr(path("f.exr"));
  for (const ivec2& pixel : {ivec2(6, 4), ivec2(24, 20), ivec2(47, 39)}) {
    const double x = (pixel.x + 0.5 - 24) / 24 * 0.5, y = (pixel.y + 0.5 - 20) / 24 * 0.5;
    const double distance = 5 * std::sqrt(1 + x * x + y * y);
    EXPECT_NEAR(frame.at("mist.Y")(pixel.x - 6, pixel.y - 4), (distance - 4) / 4, 1e-3);
    EXPECT_NEAR(frame.at("depth_mean.Z")(pixel.x - 6, pixel.y - 4), 5, 1e-3);
  }
}

}  // namespace
}  // namespace brume
