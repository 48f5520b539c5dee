// Cryptomatte from the command line: what a frame's mattes are, kept and taken out.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "image/exr_io.h"
#include "image/picture_io.h"
#include "tests/support/command_folder.h"

namespace brume {
namespace {

using test::holds;
using test::run_brume;

const std::string kTiny = " -D film.width=48 -D film.height=40 --spp 4 -q ";

class Matte : public test::CommandFolder {
 protected:
  Matte() {
    test::write_file(
        folder_ / "two.toml",
        fmt::format("[camera]\nposition = [0, -7, 2]\nlook_at = [0, 0, 1]\nfov = 34\n"
                    "[environment]\nradiance = 0.5\n"
                    "[[volumes]]\nfile = \"{0}\"\nsigma_t = 5\nname = \"R\u00f6k\"\n"
                    "[[volumes]]\nfile = \"{0}\"\nsigma_t = 5\n"
                    "object_to_world = [[1,0,0,0.4],[0,1,0,0.5],[0,0,1,0],[0,0,0,1]]\n"
                    "[[surfaces]]\nfile = \"{1}\"\nmaterial_name = \"grass\"\n",
                    test::source("data/volumes/smoke.vdb").string(), test::source("data/meshes/floor.obj").string()));
  }
  void render(const std::string& arguments, const std::string& to) {
    run("render " + path("two.toml") + kTiny + arguments + " -o " + path(to));
  }
};

TEST_F(Matte, AddUpToAlphaAndAreTheSameClean) {
  render("--layers cryptomatte", "raw.exr");
  render("--clean --layers direct,indirect,cryptomatte", "clean.exr");
  const Layers raw = read_exr(path("raw.exr")), clean = read_exr(path("clean.exr"));
  run("matte " + path("raw.exr") + " '*' --layer CryptoObject -o " + path("all.exr"));
  const Layers all = read_exr(path("all.exr"));
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 48; ++x) {
      ASSERT_NEAR(all.at("A")(x, y), raw.at("A")(x, y), 1e-6f) << x << " " << y;
      ASSERT_EQ(clean.at("A")(x, y), raw.at("A")(x, y)) << x << " " << y;
      for (const std::string channel : {"CryptoObject00.r", "CryptoObject01.a", "CryptoMaterial00.g"})
        ASSERT_EQ(clean.at(channel)(x, y), raw.at(channel)(x, y)) << channel;
    }
  // The picture has the bits that it has without.
  render("--layers direct,indirect", "plain.exr");
  render("--layers direct,indirect,cryptomatte_object -D render.cryptomatte_levels=2", "with.exr");
  const Layers plain = read_exr(path("plain.exr")), with = read_exr(path("with.exr"));
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 48; ++x) ASSERT_EQ(plain.at("R")(x, y), with.at("R")(x, y));
  EXPECT_TRUE(with.find("CryptoObject00.r"));
  EXPECT_FALSE(with.find("CryptoObject01.r"));
  EXPECT_FALSE(with.find("CryptoMaterial00.r"));
}

TEST_F(Matte, AreToldAndTakenOut) {
  render("--layers cryptomatte", "f.exr");
  const auto info = run_brume("info " + path("f.exr"));
  EXPECT_TRUE(holds(info.out, "Cryptomatte CryptoObject, 6 levels: R\u00f6k, floor, smoke")) << info.out;
  EXPECT_TRUE(holds(info.out, "Cryptomatte CryptoMaterial, 6 levels: grass, volume")) << info.out;
  const auto j = nlohmann::json::parse(run_brume("info --json " + path("f.exr")).out);
  EXPECT_EQ(j["mattes"][1]["manifest"].size(), 3u);
  run("matte " + path("f.exr") + " R\u00f6k -o " + path("one.exr"));
  run("matte " + path("f.exr") + " smoke -o " + path("other.exr"));
  run("matte " + path("f.exr") + " volume --layer CryptoMaterial -o " + path("both.exr"));
  run("matte " + path("f.exr") + " grass -o " + path("grass.png"));
  const Layers one = read_exr(path("one.exr")), other = read_exr(path("other.exr")), both = read_exr(path("both.exr"));
  double sum = 0;
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 48; ++x) {
      ASSERT_NEAR(one.at("R")(x, y) + other.at("R")(x, y), both.at("R")(x, y), 1e-6f);
      sum += both.at("R")(x, y);
    }
  EXPECT_GT(sum, 40);
  const std::string unknown = refused("matte " + path("f.exr") + " smokey -o " + path("x.exr"));
  EXPECT_TRUE(holds(unknown, "f.exr") && holds(unknown, "smokey") && holds(unknown, "smoke")) << unknown;
  EXPECT_TRUE(holds(refused("matte " + path("one.exr") + " smoke -o " + path("x.exr")), "has no Cryptomatte"));
  EXPECT_TRUE(holds(refused("matte " + path("f.exr") + " smoke -o " + path("f.exr")), "f.exr"));
  EXPECT_TRUE(
      holds(refused("render " + path("two.toml") + kTiny + "--part 1/2 --layers cryptomatte -o " + path("x.exr")),
            "without --part"));
}

TEST_F(Matte, AreKeptByDenoiseBitForBit) {
  render("--layers direct,indirect,gradient,coverage,transmittance,cryptomatte", "f.exr");
  run("denoise " + path("f.exr") + " -f nl_means -q -o " + path("clean.exr"));
  run("denoise " + path("f.exr") + " -f nl_means -q --keep-file -o " + path("kept.exr"));
  const Layers before = read_exr(path("f.exr"));
  for (const std::string name : {"clean.exr", "kept.exr"}) {
    const Layers after = read_exr(path(name));
    int compared = 0;
    for (const auto& [channel, plane] : before.channels()) {
      if (!channel.starts_with("Crypto")) continue;
      ++compared;
      ASSERT_TRUE(after.find(channel)) << name << " " << channel;
      for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 48; ++x) ASSERT_EQ(after.at(channel)(x, y), plane(x, y)) << name << " " << channel;
    }
    EXPECT_EQ(compared, 24);
    EXPECT_NE(after.at("R")(24, 20), before.at("R")(24, 20));
    run("matte " + path(name) + " smoke -o " + path("matte.exr"));
  }
}

// With a deep picture, whose alpha the frame has.
TEST_F(Matte, GoWithDeepPicturesAndHoldouts) {
  const std::string held = " -D volumes.1.role=holdout ";
  render("--clean --layers direct,indirect,cryptomatte --deep " + path("d.exr") + held, "f.exr");
  run("flatten " + path("d.exr") + " -q -o " + path("flat.exr"));
  run("matte " + path("f.exr") + " '*' --layer CryptoObject -o " + path("all.exr"));
  const Layers frame = read_exr(path("f.exr")), flat = read_exr(path("flat.exr")), all = read_exr(path("all.exr"));
  render("--layers cryptomatte" + held, "alone.exr");
  const Layers alone = read_exr(path("alone.exr"));
  double lowest = 1, difference = 0;
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 48; ++x) {
      ASSERT_NEAR(flat.at("A")(x, y), frame.at("A")(x, y), 1e-3f);
      ASSERT_NEAR(all.at("A")(x, y), frame.at("A")(x, y), 1e-6f);
      lowest = std::min(lowest, static_cast<double>(frame.at("A")(x, y)));
      difference += std::abs(alone.at("A")(x, y) - frame.at("A")(x, y)) / (40.0 * 48);
    }
  EXPECT_LT(lowest, 0.7) << "the holdout's hole in the floor";
  EXPECT_LT(difference, 6e-3) << "the deep picture has four rays in a pixel";
}

// What guides know of held out volumes is right: the clean picture is far nearer to the truth than the noisy one.
TEST_F(Matte, HoldoutsAreCleaned) {
  const std::string held = " -D volumes.1.role=holdout ";
  render("--clean" + held, "clean.exr");
  render(held, "noisy.exr");
  run("render " + path("two.toml") + " -D film.width=48 -D film.height=40 --spp 1024 --seed 7 -q --layers none -o " +
      path("truth.exr") + held);
  const auto error = [&](const std::string& name) {
    const auto r = run_brume("compare --json -q " + path(name) + " " + path("truth.exr"));
    return nlohmann::json::parse(r.out)["metrics"]["lab_rms"].get<double>();
  };
  EXPECT_LT(error("clean.exr"), 0.5 * error("noisy.exr"));
}

}  // namespace
}  // namespace brume
