// Frames by Cycles: their passes are cleaned one by one, and their sum is the picture.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "image/exr_io.h"
#include "tests/support/cycles_frame.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"
#include "tests/support/foreign_frames.h"

namespace brume {
namespace {

using test::channels_of;
using test::cycles_header;
using test::cycles_value;
using test::error;
using test::expect_sum;
using test::Frames;
using test::header_of;
using test::holds;
using test::kHeight;
using test::kWidth;
using test::noisy;
using test::run_brume;

TEST_F(Frames, ACyclesFrameComesBackWithItsPassesCleanAndTheirSumExact) {
  for (const Imf::PixelType type : {Imf::HALF, Imf::FLOAT}) {
    write({{cycles_header(type), cycles_value}});
    const std::string said = denoise();
    expect_kept_but({"My Layer.Combined", "My Layer.VolumeDir", "My Layer.VolumeInd", "My Layer.Env"});
    expect_sum(out, type == Imf::HALF);
    EXPECT_TRUE(holds(
        said,
        "Blender Cycles multilayer 'My Layer': cleaned VolumeDir, VolumeInd, Env with bilateral, Combined = VolumeDir + VolumeInd + Env + Emit"))
        << said;
    EXPECT_TRUE(holds(said, "no variance in the file for VolumeDir, VolumeInd, Env: estimated")) << said;
    const Layers before = read_exr(in), after = read_exr(out);
    for (const char* channel : {"My Layer.VolumeDir.R", "My Layer.VolumeInd.G", "My Layer.Env.B"})
      EXPECT_LT(error(after, channel), 0.6 * error(before, channel)) << channel;
    EXPECT_EQ(after.text("brume.filter"), "bilateral");
    EXPECT_EQ(after.text("brume.sum"), "Combined = VolumeDir + VolumeInd + Env + Emit");
  }
}

TEST_F(Frames, WithoutAFilterItTakesTheBestThatTheFileAllows) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  EXPECT_TRUE(holds(denoise(""), "Env with least_risk"));
  expect_sum(out, false);
}

TEST_F(Frames, TheExposureIsTheFiltersAndThePictures) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  denoise("-f bilateral --exposure 2");
  EXPECT_EQ(read_exr(out).number("brume.filterExposure"), 2.0);
  denoise("-f bilateral --exposure auto --png " + path("p.png"));
  EXPECT_NEAR(read_exr(out).number("brume.filterExposure").value_or(0), 1 / 3.6, 0.05);
}

// In whichever unit a renderer counts light.
TEST_F(Frames, VeryDarkOnesAreCleanedAsBrightOnesAre) {
  std::vector<Layers> clean;
  for (const double unit : {1.0, 0x1p-24}) {
    write({{header_of({":RGB"}, Imf::FLOAT),
            [&](const std::string& channel, int x, int y) { return unit * noisy(channel, x, y); }}});
    denoise(fmt::format("--exposure {}", 1 / unit));
    clean.push_back(read_exr(out));
    EXPECT_NEAR(*clean.back().number("brume.filterExposure"), 1 / unit, 1e-6 / unit);
  }
  for (const char* channel : {"R", "G", "B"})
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        ASSERT_NEAR(0x1p24 * clean[1].at(channel)(x, y), clean[0].at(channel)(x, y), 1e-3) << x << " " << y;
}

TEST_F(Frames, OnlyIndirectPassesWhereThatIsAsked) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  denoise("-f bilateral --component indirect");
  expect_kept_but({"My Layer.Combined", "My Layer.VolumeInd"});
  expect_sum(out, false);
}

TEST_F(Frames, WhatThePassesLeaveIsCleanedToo) {
  const auto value = [](const std::string& channel, int x, int y) {
    return cycles_value(channel, x, y) + (holds(channel, ".Combined.") ? noisy(channel, x, y) : 0);
  };
  write({{cycles_header(Imf::FLOAT), value}});
  const std::string said = denoise();
  EXPECT_TRUE(holds(said, "the passes do not make up the whole of Combined")) << said;
  EXPECT_TRUE(holds(said, "+ Emit + the rest")) << said;
  const Layers before = read_exr(in), after = read_exr(out);
  double light = 0, kept = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      light += static_cast<double>(before.at("My Layer.Combined.R")(x, y));
      kept += static_cast<double>(after.at("My Layer.Combined.R")(x, y));
    }
  EXPECT_NEAR(kept / light, 1.0, 0.02);
}

TEST_F(Frames, SurfacePassesAreMultipliedByTheirColour) {
  Imf::Header header =
      header_of({"V.Combined:RGB", "V.DiffDir:RGB", "V.DiffInd:RGB", "V.DiffCol:RGB", "V.VolumeDir:RGB"}, Imf::FLOAT);
  const auto value = [](const std::string& channel, int x, int y) -> double {
    const std::string c(1, channel.back());
    const auto stored = [&](const std::string& pass) { return static_cast<float>(noisy("V." + pass + "." + c, x, y)); };
    if (!holds(channel, "Combined")) return noisy(channel, x, y);
    return static_cast<double>((stored("DiffDir") + stored("DiffInd")) * stored("DiffCol") + stored("VolumeDir"));
  };
  write({{header, value}});
  EXPECT_TRUE(holds(denoise(), "Combined = (DiffDir + DiffInd) * DiffCol + VolumeDir"));
  expect_kept_but({"V.Combined", "V.DiffDir", "V.DiffInd", "V.VolumeDir"});
  const Layers frame = read_exr(out);
  const auto at = [&](const char* pass) { return frame.at(std::string("V.") + pass + ".G")(7, 5); };
  EXPECT_EQ(at("Combined"), (at("DiffDir") + at("DiffInd")) * at("DiffCol") + at("VolumeDir"));
}

// Light groups add up to the clean picture; with what lights without a group leave where there are any.
TEST_F(Frames, LightGroupsOfCyclesAreCleanAndAddUp) {
  for (const bool others : {false, true}) {
    const auto value = [&](const std::string& channel, int x, int y) -> double {
      const std::string c(1, channel.back());
      const auto stored = [&](const std::string& pass) {
        return static_cast<float>(noisy("V." + pass + "." + c, x, y));
      };
      if (!holds(channel, "Combined.")) return noisy(channel, x, y);
      return static_cast<double>(stored("Combined_key") + stored("Combined_rim.001") + (others ? 0.5f : 0.0f));
    };
    write({{header_of({"V.Combined:RGB", "V.Combined_key:RGB", "V.Combined_rim.001:RGB"}, Imf::FLOAT), value}});
    const std::string said = denoise();
    EXPECT_TRUE(holds(said, "cleaned Combined, Combined_key, Combined_rim.001")) << said;
    expect_kept_but({"V.Combined", "V.Combined_key", "V.Combined_rim.001"});
    const Layers before = read_exr(in), after = read_exr(out);
    for (const char* channel : {"V.Combined_key.R", "V.Combined_rim.001.G"})
      EXPECT_LT(error(after, channel), 0.7 * error(before, channel)) << channel;
    double rest = 0;
    for (int y = 0; y < after.height(); ++y)
      for (int x = 0; x < after.width(); ++x) {
        const auto at = [&](const char* pass) {
          return static_cast<double>(after.at(std::string("V.") + pass + ".G")(x, y));
        };
        const double left = at("Combined") - at("Combined_key") - at("Combined_rim.001");
        if (!others) {
          EXPECT_NEAR(left, 0, 1e-7 * at("Combined")) << x << " " << y;
        }
        rest += left / (after.width() * after.height());
      }
    EXPECT_NEAR(rest, others ? 0.5 : 0.0, 0.05);
  }
}

TEST_F(Frames, CleanLayersMayStandBesideTheNoisy) {
  write({{cycles_header(Imf::HALF), cycles_value}});
  denoise("-f bilateral --suffix _clean");
  const auto before = test::exr_bits(in), after = test::exr_bits(out);
  std::set<std::string> added;
  for (const char* pass : {"Combined", "VolumeDir", "VolumeInd", "Env"})
    for (const std::string& name : channels_of(std::string("My Layer.") + pass + "_clean"))
      added.insert("/" + name + "/0,0");
  EXPECT_EQ(test::differing(before, after), added);
  EXPECT_EQ(read_exr(out).text("brume.sum"), "Combined_clean = VolumeDir_clean + VolumeInd_clean + Env_clean + Emit");
  const auto again = run_brume("denoise " + out + " -o " + path("again.exr") + " -f bilateral --suffix _clean");
  EXPECT_EQ(again.status, 2);
  EXPECT_TRUE(holds(again.err, "take another suffix")) << again.err;
  write({{header_of({":RGB"}, Imf::FLOAT), noisy}});
  denoise("-f bilateral --suffix _clean");
  EXPECT_NE(read_exr(out).find("clean.R"), nullptr) << "no layer's name begins with an underline";
}

TEST_F(Frames, WhatIsSaidIsTrueOfTheFrame) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  const std::string best = denoise("");
  EXPECT_TRUE(holds(best, "guides from their volume leave a quarter of the error: brume guides --like " + in)) << best;
  std::filesystem::copy_file(out, path("again.exr"));
  const std::string regression = denoise("-f transport_regression");
  EXPECT_TRUE(holds(regression, "the frame has no half images to judge by")) << regression;
  EXPECT_FALSE(holds(regression, "brume render")) << regression;
  std::filesystem::remove(out);
  for (const std::string filter : {"nfor", "welch", "random_parameter", "virtual_flash:guide=flash"}) {
    const std::string said = refused("-f " + filter);
    EXPECT_TRUE(holds(said, "This frame is by another renderer (read as Blender Cycles multilayer)")) << said;
    EXPECT_FALSE(holds(said, "brume render")) << said;
  }
  // Clean frames are not cleaned once more in silence.
  in = path("again.exr");
  EXPECT_TRUE(holds(denoise("-f bilateral"), "the frame is clean already, by ")) << in;
  write_exr(path("noisy.exr"), test::noisy_frame(kWidth, kHeight, 3));
  in = path("noisy.exr"), out = path("once.exr");
  EXPECT_FALSE(holds(denoise("-f bilateral"), "clean already"));
  in = path("once.exr"), out = path("twice.exr");
  EXPECT_TRUE(holds(denoise(""), "the frame is clean already, by bilateral"));
}

TEST_F(Frames, EveryViewLayerIsCleaned) {
  Imf::Header header = header_of({"fog.Combined:RGBA", "set.Combined:RGBA"}, Imf::FLOAT);
  write({{header, noisy}});
  const std::string said = denoise();
  expect_kept_but({"fog.Combined", "set.Combined"});
  EXPECT_TRUE(holds(said, "'fog'") && holds(said, "'set'")) << said;
}

// A real one: half and float mixed, names of more than 31 letters, layers of every kind.
TEST_F(Frames, AFrameByCyclesWithEveryPassComesBack) {
  const auto odd = test::shared("references/cycles/odd/allpasses_half_64.exr");
  if (odd.empty()) GTEST_SKIP() << "no reference frames beside the project";
  in = odd.string();
  denoise("");
  expect_kept_but({"My Layer.Combined", "My Layer.VolumeDir", "My Layer.VolumeInd", "My Layer.Env"});
  expect_sum(out, true);
}

}  // namespace
}  // namespace brume
