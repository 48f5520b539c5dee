// Frames of other renderers through the program: the file that comes back is compared with the one that went in.

#include "tests/support/frames.h"

#include <ImfChannelList.h>
#include <ImfKeyCodeAttribute.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "image/exr_copy.h"
#include "image/exr_io.h"
#include "image/pfm_io.h"
#include "image/picture_io.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using test::channels_of;
using test::ExrPart;
using test::run_brume;

constexpr int kWidth = 30, kHeight = 22;

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A smooth picture of its own for each channel, with the noise of a renderer.
double truth(const std::string& channel, int x, int y) {
  return 1 + 0.2 * std::sin(0.1 * x + 0.07 * y + static_cast<double>(std::hash<std::string>()(channel) % 7));
}
double noisy(const std::string& channel, int x, int y) {
  return std::max(0.0, truth(channel, x, y) + 0.1 * test::normal(x, y, std::hash<std::string>()(channel)));
}

/// Channels in groups of one layer and type: "V.Combined:RGBA".
Imf::Header header_of(const std::vector<std::string>& layers, Imf::PixelType type) {
  Imf::Header header = test::exr_header(kWidth, kHeight);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const std::string& text : layers) {
    const size_t colon = text.rfind(':');
    test::add_channels(header, channels_of(text.substr(0, colon), text.substr(colon + 1)), type);
  }
  return header;
}

class Frames : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void write(const std::vector<ExrPart>& parts) { test::write_exr_file(in, parts); }
  /// Cleans `in` to `out`. @return what was said
  std::string denoise(const std::string& options = "-f bilateral") {
    const auto r = run_brume("denoise " + in + " -o " + out + " " + options);
    EXPECT_EQ(r.status, 0) << r.err;
    return r.err;
  }
  std::string refused(const std::string& options = "-f bilateral") {
    const auto r = run_brume("denoise " + in + " -o " + out + " " + options);
    EXPECT_EQ(r.status, 2) << r.err;
    EXPECT_FALSE(std::filesystem::exists(out));
    EXPECT_FALSE(test::has_half_written(folder_.path()));
    return r.err;
  }
  /// Everything is as it was but these layers of colours, and what says so in the header.
  void expect_kept_but(const std::vector<std::string>& layers, const std::string& letters = "RGB") {
    EXPECT_EQ(test::exr_channels(in), test::exr_channels(out));
    for (const std::string& name : test::differing(test::exr_attributes(in), test::exr_attributes(out)))
      EXPECT_TRUE(holds(name, "/brume.") || name == "/fileChecksum") << name;
    std::set<std::string> changed;
    for (const std::string& layer : layers)
      for (const std::string& name : channels_of(layer, letters)) changed.insert("/" + name + "/0,0");
    EXPECT_EQ(test::differing(test::exr_bits(in), test::exr_bits(out)), changed);
  }

  test::TemporaryFolder folder_;
  std::string in = path("shot.exr"), out = path("clean.exr");
};

double error(const Layers& frame, const std::string& channel) {
  double sum = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x)
      sum += std::pow(static_cast<double>(frame.at(channel)(x, y)) - truth(channel, x, y), 2);
  return std::sqrt(sum / (frame.width() * frame.height()));
}

Imf::Header cycles_header(Imf::PixelType type) {
  Imf::Header header =
      header_of({"My Layer.Combined:RGBA", "My Layer.VolumeDir:RGB", "My Layer.VolumeInd:RGB", "My Layer.Env:RGB",
                 "My Layer.Emit:RGB", "My Layer.Denoising Albedo:RGB", "My Layer.Shadow:RGB"},
                type);
  test::add_channels(header, channels_of("My Layer.CryptoObject00", "rgba"), Imf::FLOAT);
  test::add_channels(header, channels_of("My Layer.Vector", "XYZW"), Imf::FLOAT);
  test::add_channels(header, {"My Layer.Depth.Z"}, Imf::FLOAT);
  test::add_channels(header, {"My Layer.IndexOB.X"}, Imf::UINT);
  header.insert("cycles.My Layer.samples", Imf::StringAttribute("8"));
  header.insert("key", Imf::KeyCodeAttribute(Imf::KeyCode(1, 2, 3, 4, 5)));
  return header;
}

double cycles_value(const std::string& channel, int x, int y) {
  const char c = channel.back();
  if (holds(channel, ".Emit.")) return 0;
  if (!holds(channel, ".Combined.") || c == 'A') return noisy(channel, x, y);
  double sum = 0;
  for (const char* pass : {"VolumeDir", "VolumeInd", "Env"})
    sum += noisy(std::string("My Layer.") + pass + "." + c, x, y);
  return sum;
}

// The sum of the passes as they are stored, in the order that the header states, is the picture to the last bit.
void expect_sum(const std::string& path, bool half) {
  const Layers frame = read_exr(path);
  for (const char c : {'R', 'G', 'B'}) {
    const auto pass = [&](const char* name) -> const Plane& {
      return frame.at(std::string("My Layer.") + name + "." + c);
    };
    Plane sum(frame.width(), frame.height());
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        sum(x, y) = ((pass("VolumeDir")(x, y) + pass("VolumeInd")(x, y)) + pass("Env")(x, y)) + pass("Emit")(x, y);
    if (half) round_to_half(sum);
    size_t differing = 0;
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        differing += std::bit_cast<uint32_t>(sum(x, y)) != std::bit_cast<uint32_t>(pass("Combined")(x, y));
    EXPECT_EQ(differing, 0u) << c;
  }
}

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

TEST_F(Frames, PbrtsFilmIsCleanedByItsOwnVariance) {
  Imf::Header header = header_of(
      {":RGB", "Albedo:RGB", "Ns:XYZ", "N:XYZ", "P:XYZ", "Variance:RGB", "RelativeVariance:RGB", "dzdx:Y"}, Imf::HALF);
  const auto value = [](const std::string& channel, int x, int y) {
    return holds(channel, "Variance") ? 0.16 : noisy(channel, x, y);  // 16 samples of standard deviation 0.4
  };
  write({{header, value}});
  const std::string guessed = denoise("-f sbf");
  EXPECT_TRUE(holds(guessed, "the variance of the samples of RGB cannot be used")) << guessed;
  EXPECT_TRUE(holds(guessed, "no variance in the file for RGB: estimated")) << guessed;
  EXPECT_TRUE(holds(guessed, "16 bits")) << guessed;
  const std::string said = denoise("-f sbf --samples 16");
  EXPECT_FALSE(holds(said, "estimated")) << said;
  expect_kept_but({""});
  EXPECT_LT(error(read_exr(out), "G"), 0.7 * error(read_exr(in), "G"));
}

// As pbrt-v4 does where no sample of a pixel meets a surface.
TEST_F(Frames, PixelsWithLightAndNoVarianceGetAnEstimate) {
  Imf::Header header =
      header_of({":RGB", "Albedo:RGB", "Ns:XYZ", "P:XYZ", "Variance:RGB", "RelativeVariance:RGB"}, Imf::FLOAT);
  const auto value = [](const std::string& channel, int x, int y) {
    return holds(channel, "Variance") ? (x < kWidth / 2 ? 0.16 : 0.0) : noisy(channel, x, y);
  };
  write({{header, value}});
  const std::string said = denoise("-f sbf --samples 16");
  EXPECT_TRUE(holds(said, "50 % of the lit pixels of RGB have no variance")) << said;
}

TEST_F(Frames, FramesOfOtherRenderersComeBackAsTheyCame) {
  struct Case {
    std::vector<std::string> layers;
    std::string renderer;
    std::vector<std::string> cleaned;
    std::string letters = "RGB";
  };
  const std::vector<Case> cases = {
      {{":RGBA", "img:RGBA", "nn:XYZ", "dd:T", "m:XYZ", "m2_img:RGBA", "m2_m:XYZ"}, "Mitsuba 3", {"", "img"}},
      {{"Ci:rgba", "mse:rgb", "albedo:rgb", "albedo_mse:rgb", "normal:xyz", "normal_var:xyz", "sampleCount:r",
        "CryptoMaterial00:rgba"},
       "RenderMan",
       {"Ci"},
       "rgb"},
      {{":RGBA", "variance:RGB", "denoise_albedo:RGB", "N:XYZ", "Z:Z", "sss:RGB"}, "Arnold", {""}},
      {{":RGB", "albedo:RGB", "normal:XYZ"}, "a frame of colours", {""}},
      {{"beauty:rgb", "alb:rgb", "nrm:xyz", "uv:xy", "motion:xy"}, "a frame of colours 'beauty'", {"beauty"}, "rgb"},
  };
  for (const Case& c : cases)
    for (const Imf::PixelType type : {Imf::HALF, Imf::FLOAT}) {
      write({{header_of(c.layers, type), noisy}});
      EXPECT_TRUE(holds(denoise("-f bilateral"), "brume: " + c.renderer)) << c.renderer;
      expect_kept_but(c.cleaned, c.letters);
    }
}

TEST_F(Frames, VarianceOfUnstatedLevelIsGivenThePicturesOwn) {
  Imf::Header header = header_of({":RGBA", "variance:RGB", "denoise_albedo:RGB"}, Imf::FLOAT);
  const auto value = [](const std::string& channel, int x, int y) {
    return holds(channel, "variance") ? 0.01 * 64 : noisy(channel, x, y);  // of 64 samples each
  };
  write({{header, value}});
  const std::string said = denoise("-f sbf");
  const size_t at = said.find("(times ");
  ASSERT_NE(at, std::string::npos) << said;
  EXPECT_NEAR(std::stod(said.substr(at + 7)), 1.0 / 64, 0.3 / 64) << said;
}

TEST_F(Frames, PartsTilesAndLevelsComeBack) {
  std::vector<ExrPart> parts;
  for (const std::string name : {"rgba", "albedo", "crypto"}) {
    Imf::Header header = test::exr_header(kWidth, kHeight);
    header.setName(name);
    test::add_channels(header, channels_of("", name == "crypto" ? "rgba" : "RGB"),
                       name == "rgba" ? Imf::HALF : Imf::FLOAT);
    if (name == "rgba") header.setTileDescription(Imf::TileDescription(16, 16, Imf::MIPMAP_LEVELS, Imf::ROUND_UP));
    if (name == "crypto") header.dataWindow() = Imath::Box2i(Imath::V2i(3, 4), Imath::V2i(9, 11));
    if (name == "albedo") header.dataWindow() = Imath::Box2i(Imath::V2i(-5, 2), Imath::V2i(40, 30));
    parts.push_back({header, noisy});
  }
  write(parts);
  denoise("-f sbf");
  EXPECT_EQ(test::exr_channels(in), test::exr_channels(out));
  const auto brightness = [&](const std::string& path) {
    return read_exr(path, [](const std::string& name) { return name == "rgba.G"; }).at("rgba.G")(0, 0);
  };
  EXPECT_NEAR(brightness(out), brightness(in), 0.3f) << "no black comes in from the wider part of the albedo";
  for (const std::string& name : test::differing(test::exr_attributes(in), test::exr_attributes(out)))
    EXPECT_TRUE(holds(name, "rgba/brume.")) << name;
  std::set<std::string> changed;
  for (const char* channel : {"R", "G", "B"})
    for (const char* level : {"0,0", "1,1", "2,2", "3,3", "4,4", "5,5"})
      changed.insert(std::string("rgba/") + channel + "/" + level);
  EXPECT_EQ(test::differing(test::exr_bits(in), test::exr_bits(out)), changed);
}

/// A part with RGB or other channels, its window as the display's unless given.
ExrPart part_of(const std::string& name, const std::string& view, const std::vector<std::string>& channels) {
  Imf::Header header = test::exr_header(kWidth, kHeight);
  header.setName(name);
  header.setType(Imf::SCANLINEIMAGE);
  if (!view.empty()) header.setView(view);
  test::add_channels(header, channels, Imf::FLOAT);
  return {header, [name](const std::string& channel, int x, int y) { return noisy(name + channel, x, y); }};
}

TEST_F(Frames, BothEyesInPartsAreCleanedAndAllElseComesBack) {
  ExrPart depth = part_of("depth_left", "left", {"Z"});
  depth.header.dataWindow() = Imath::Box2i(Imath::V2i(2, 3), Imath::V2i(kWidth - 3, kHeight - 2));
  ExrPart left = part_of("rgba_left", "left", channels_of("", "RGBA"));
  left.header.dataWindow() = Imath::Box2i(Imath::V2i(1, 0), Imath::V2i(kWidth - 1, kHeight - 4));
  write({part_of("rgba_right", "right", channels_of("", "RGBA")), left, depth});
  const std::string said = denoise("-f sbf");
  EXPECT_TRUE(holds(said, "'right': cleaned rgba_right") && holds(said, "'left': cleaned rgba_left")) << said;
  EXPECT_EQ(test::exr_channels(in), test::exr_channels(out));
  for (const std::string& name : test::differing(test::exr_attributes(in), test::exr_attributes(out)))
    EXPECT_TRUE(holds(name, "rgba_left/brume.") || holds(name, "rgba_right/brume.")) << name;
  std::set<std::string> changed;
  for (const char* eye : {"rgba_left", "rgba_right"})
    for (const char* c : {"R", "G", "B"}) changed.insert(std::string(eye) + "/" + c + "/0,0");
  EXPECT_EQ(test::differing(test::exr_bits(in), test::exr_bits(out)), changed);

  const auto info = run_brume("info " + in);
  EXPECT_TRUE(holds(info.out, "part depth_left (view left): Z, data window 2,3,28,21")) << info.out;
  EXPECT_TRUE(holds(info.out, "read as a frame of colours 'left': rgba_left")) << info.out;
  const auto j = nlohmann::json::parse(run_brume("info --json " + in).out);
  EXPECT_EQ(j["parts"][0]["view"], "right");
  const auto picture = run_brume("picture " + in + " -o " + path("p.png"));
  EXPECT_EQ(picture.status, 0) << picture.err;
  EXPECT_TRUE(holds(picture.err, "rgba_right; the first of 2 pictures")) << picture.err;
  EXPECT_EQ(run_brume("picture " + in + " --layer rgba_left -o " + path("q.png")).status, 0);
}

TEST_F(Frames, TheEyesOfOnePartAreCleaned) {
  Imf::Header header = header_of({":RGBA", "left:RGBA", "depth.left:Z"}, Imf::HALF);
  Imf::addMultiView(header, {"right", "left"});
  write({{header, noisy}});
  const std::string said = denoise("-f bilateral");
  expect_kept_but({"", "left"});
  EXPECT_TRUE(holds(said, "'right': cleaned RGB with") && holds(said, "'left': cleaned left with")) << said;
  EXPECT_TRUE(holds(run_brume("info " + in).out, "views right, left (multiView)"));
}

TEST_F(Frames, DeepPartsGoThrough) {
  test::write_deep_and_flat_exr(in, part_of("C", "", channels_of("", "RGBA")));
  const std::string bytes = test::deep_bytes(in, "smoke");
  ASSERT_FALSE(bytes.empty());
  denoise("-f bilateral");
  EXPECT_EQ(test::deep_bytes(out, "smoke"), bytes);
  const auto info = run_brume("info " + out);
  EXPECT_TRUE(holds(info.out, "part smoke: A Z, deepscanline")) << info.out;
  const auto picture = run_brume("picture " + out + " -o " + path("p.png"));
  EXPECT_EQ(picture.status, 0) << picture.err;
}

TEST_F(Frames, WhatIsNoPictureIsToldWithWhatIsThere) {
  write({part_of("diffuse", "", channels_of("")), part_of("specular", "", channels_of(""))});
  const std::string said = refused("");
  EXPECT_TRUE(holds(said, "it has diffuse: B G R; specular: B G R")) << said;
  EXPECT_TRUE(holds(said, "--map, docs/frames.md")) << said;
  test::write_file(path("layers.toml"), "color = \"specular\"\n");
  denoise("-f bilateral --map " + path("layers.toml"));
  std::set<std::string> changed;
  for (const char* c : {"R", "G", "B"}) changed.insert(std::string("specular/") + c + "/0,0");
  EXPECT_EQ(test::differing(test::exr_bits(in), test::exr_bits(out)), changed);
  EXPECT_TRUE(holds(run_brume("info " + in).out, "no picture is recognised in it"));
}

TEST_F(Frames, APictureUnderTwoNamesIsCleanedUnderBoth) {
  const auto same = [](const std::string& channel, int x, int y) {
    return noisy(std::string(1, channel.back()), x, y);
  };
  Imf::Header header = header_of({":RGB", "albedo:RGB"}, Imf::HALF);
  test::add_channels(header, channels_of("beauty"), Imf::FLOAT);
  write({{header, same}});
  const std::string said = denoise("-f bilateral");
  expect_kept_but({"", "beauty"});
  EXPECT_TRUE(holds(said, "\"beauty\" holds the picture's very pixels and gets the clean ones, too")) << said;
  const Layers clean = read_exr(out);
  EXPECT_NEAR(clean.at("R")(5, 5), clean.at("beauty.R")(5, 5), 1e-3f);
}

TEST_F(Frames, TwoUnlikePicturesAreNamedAndNothingIsWritten) {
  write({{header_of({":RGB", "beauty:RGB"}, Imf::HALF), noisy}});
  const std::string said = refused();
  EXPECT_TRUE(holds(said, "the picture could be any of its layers \"\", \"beauty\"")) << said;
  EXPECT_TRUE(holds(said, "differ, first at pixel 0,0; say which in a mapping file: color = \"\" (--map")) << said;
  test::write_file(path("layers.toml"), "color = \"\"\n");
  denoise("-f bilateral --map " + path("layers.toml"));
  expect_kept_but({""});
}

TEST_F(Frames, NoLightIsLeftWhereAlphaIs0) {
  const auto inside = [](int x, int y) { return x > 6 && x < 22 && y > 4 && y < 17; };
  const auto value = [&](const std::string& channel, int x, int y) {
    return !inside(x, y) ? 0.0 : channel.ends_with("A") ? 1.0 : noisy(channel, x, y);
  };
  write({{header_of({"V.Combined:RGBA", "V.VolumeDir:RGB"}, Imf::FLOAT), value}});
  const std::string said = denoise("-f gaussian");
  EXPECT_TRUE(holds(said, "alpha says without noise that")) << said;
  const Layers before = read_exr(in), after = read_exr(out);
  for (const std::string layer : {"V.Combined.R", "V.VolumeDir.G"}) {
    double light = 0, kept = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        light += static_cast<double>(before.at(layer)(x, y));
        kept += static_cast<double>(after.at(layer)(x, y));
        ASSERT_TRUE(inside(x, y) || after.at(layer)(x, y) == 0) << layer << " " << x << "," << y;
      }
    EXPECT_NEAR(kept / light, 1.0, 0.02) << layer;
  }
}

TEST_F(Frames, LuminanceAndChromaAreCleaned) {
  Imf::Header header = test::exr_header(kWidth, kHeight);
  header.channels().insert("Y", Imf::Channel(Imf::HALF));
  header.channels().insert("RY", Imf::Channel(Imf::HALF, 2, 2));
  header.channels().insert("BY", Imf::Channel(Imf::HALF, 2, 2));
  write({{header, [](const std::string& c, int x, int y) { return c == "Y" ? noisy(c, x, y) : 0.25; }}});
  denoise();
  EXPECT_EQ(test::exr_channels(in), test::exr_channels(out));
  const auto bits = test::exr_bits(out);
  double before = 0, after = 0;
  const auto noisy_bits = test::exr_bits(in);
  for (int i = 0; i < kWidth * kHeight; ++i) {
    const auto value = [&](const std::map<std::string, test::ExrBits>& all) {
      half h;
      h.setBits(static_cast<uint16_t>(all.at("/Y/0,0")[static_cast<size_t>(i)]));
      return static_cast<double>(static_cast<float>(h));
    };
    before += std::pow(value(noisy_bits) - truth("Y", i % kWidth, i / kWidth), 2);
    after += std::pow(value(bits) - truth("Y", i % kWidth, i / kWidth), 2);
  }
  EXPECT_LT(after, 0.5 * before);
  for (const uint32_t v : bits.at("/RY/0,0")) {
    half h;
    h.setBits(static_cast<uint16_t>(v));
    EXPECT_NEAR(static_cast<float>(h), 0.25f, 2e-3f);
  }
}

TEST_F(Frames, ADataWindowUnlikeTheDisplayWindowIsKept) {
  Imf::Header header = header_of({":RGB", "albedo:RGB"}, Imf::HALF);
  header.dataWindow() = Imath::Box2i(Imath::V2i(-4, 3), Imath::V2i(12, 40));
  write({{header, noisy}});
  denoise("-f bilateral --png " + path("p.png"));
  expect_kept_but({""});
}

TEST_F(Frames, NotANumberIsCountedAndNotSmeared) {
  Imf::Header header = cycles_header(Imf::FLOAT);
  const auto value = [](const std::string& channel, int x, int y) {
    const bool bad = x == 9 && y == 9 && (holds(channel, ".VolumeInd.") || holds(channel, ".Combined."));
    return bad ? std::numeric_limits<double>::quiet_NaN() : cycles_value(channel, x, y);
  };
  write({{header, value}});
  const std::string said = denoise("-f sbf");
  EXPECT_TRUE(holds(said, "note: VolumeInd: 1 pixels were NaN or infinite")) << said;
  const Layers clean = read_exr(out);
  for (const char* layer : {"Combined", "VolumeInd"})
    EXPECT_EQ(count_not_finite(clean.at(std::string("My Layer.") + layer + ".R")), 0u) << layer;
  expect_sum(out, false);
}

// The same light in two colour spaces: each file keeps its own, pictures and comparisons are those of Rec. 709.
TEST_F(Frames, ColoursStayInTheSpaceOfTheirFile) {
  const Chromaticities acescg = {0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f};
  const dmat3 from_rec709 = glm::inverse(*rec709_from(acescg, "x"));
  Layers plain(kWidth, kHeight), other(kWidth, kHeight);
  const auto a = plain.add_rgb(layer::beauty), b = other.add_rgb(layer::beauty);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const dvec3 v(0.3 * noisy("R", x, y), 0.6 * noisy("G", x, y), 0.2 * noisy("B", x, y));
      const dvec3 w = from_rec709 * v;
      for (int c = 0; c < 3; ++c) {
        (*a[static_cast<size_t>(c)])(x, y) = static_cast<float>(v[c]);
        (*b[static_cast<size_t>(c)])(x, y) = static_cast<float>(w[c]);
      }
    }
  other.header["chromaticities"] = acescg;
  write_exr(path("plain.exr"), plain);
  write_exr(in, other);
  const std::string said = denoise("-f gaussian --png " + path("clean.png"));
  EXPECT_TRUE(holds(said, "its colours are ACEScg (AP1): they stay so")) << said;
  expect_kept_but({""});
  EXPECT_EQ(read_exr(out).chromaticities(), acescg);
  ASSERT_EQ(run_brume("denoise " + path("plain.exr") + " -o " + path("plain_clean.exr") + " -f gaussian --png " +
                      path("plain.png"))
                .status,
            0);
  const Layers png = read_any_picture(path("clean.png")), plain_png = read_any_picture(path("plain.png"));
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) ASSERT_NEAR(png.at("R")(x, y), plain_png.at("R")(x, y), 0.01);
  // CIE-Lab is that of each file's colours.
  for (const char* filter : {"bilateral", "extended_bilateral", "a_trous"}) {
    for (const std::string& frame : {in, path("plain.exr")})
      ASSERT_EQ(run_brume("denoise " + frame + " -o " + frame + "." + filter + ".exr -f " + filter).status, 0)
          << filter;
    const auto same = run_brume("compare " + in + "." + filter + ".exr " + path("plain.exr.") + filter + ".exr --json");
    EXPECT_LT(nlohmann::json::parse(same.out)["metrics"]["lab_rms"].get<double>(), 1e-3) << filter;
  }
  const auto compared = run_brume("compare " + in + " " + path("plain.exr") + " --json");
  ASSERT_EQ(compared.status, 0) << compared.err;
  EXPECT_TRUE(holds(compared.err, "shot.exr: its colours are ACEScg (AP1): compared in linear Rec. 709"))
      << compared.err;
  EXPECT_LT(nlohmann::json::parse(compared.out)["metrics"]["lab_rms"].get<double>(), 1e-3);
  other.header["chromaticities"] = Chromaticities{};
  write_exr(path("none.exr"), other);
  const auto cleaned = run_brume("denoise " + path("none.exr") + " -o " + path("none_clean.exr") + " -f gaussian");
  EXPECT_EQ(cleaned.status, 0);
  EXPECT_TRUE(holds(cleaned.err, "filters take its colours for Rec. 709")) << cleaned.err;
  const auto shown = run_brume("picture " + path("none.exr") + " -o " + path("none.png"));
  EXPECT_EQ(shown.status, 2);
  EXPECT_TRUE(holds(shown.err, "none.exr: chromaticities 0 0, 0 0")) << shown.err;
}

TEST_F(Frames, TwoCandidatesAreListedAndAMapDecides) {
  write({{header_of({":RGB", "albedo:RGB", "diffuse_albedo:RGB"}, Imf::FLOAT), noisy}});
  EXPECT_TRUE(holds(refused(), "the albedo could be any of albedo, diffuse_albedo; say which in a mapping file"));
  test::write_file(path("layers.toml"), "color = \"\"\nalbedo = \"diffuse_albedo\"\n");
  denoise("-f bilateral --map " + path("layers.toml"));
  expect_kept_but({""});
}

TEST_F(Frames, AMapNamesPassesVarianceAndSamples) {
  write({{header_of({"look.dev:RGB", "fog:rgb", "fog noise:rgb", "rest of it:RGB", "cnt:Y", "odd:RGB", "even:RGB"},
                    Imf::FLOAT),
          [](const std::string& channel, int x, int y) {
            if (channel == "cnt.Y") return 4.0;
            if (!holds(channel, "look.dev")) return noisy(channel, x, y);
            const char c = channel.back();
            return noisy(std::string("fog.") + static_cast<char>(std::tolower(c)), x, y) +
                   noisy(std::string("rest of it.") + c, x, y);
          }}});
  test::write_file(
      path("layers.toml"),
      "renderer = \"House\"\ncolor = [\"look.dev.R\", \"look.dev.G\", \"look.dev.B\"]\nsample_count = \"cnt\"\n"
      "halves = [\"odd\", \"even\"]\n"
      "[[passes]]\nlayer = \"fog\"\nvariance = \"fog noise\"\nvariance_is = \"samples\"\nindirect = true\n"
      "[[passes]]\nlayer = \"rest of it\"\n");
  const std::string said = denoise("-f sbf --map " + path("layers.toml"));
  EXPECT_TRUE(holds(said, "House: cleaned fog, rest of it with sbf, dev = fog + rest of it")) << said;
  EXPECT_TRUE(holds(said, "no variance in the file for rest of it: estimated")) << said;
}

TEST_F(Frames, AMapsMistakesAreUnderlined) {
  Imf::Header header = header_of({":RGB", "albedo:RGB", "CryptoObject00:RGB"}, Imf::FLOAT);
  test::add_channels(header, channels_of("id"), Imf::UINT);
  write({{header, noisy}});
  const std::pair<std::string, std::string> mistakes[] = {
      {"color = \"\"\nalbdo = \"albedo\"\n", "unknown key 'albdo'; did you mean 'albedo'?"},
      {"color = \"\"\nalbedo = \"albeda\"\n",
       "the file has no layer 'albeda' of three channels R G B or X Y Z; did you mean 'albedo'?"},
      {"color = [\"R\", \"G\", \"b\"]\n", "the file has no channel 'b'"},
      {"color = \"CryptoObject00\"\n", "holds identities, which are never filtered"},
      {"color = \"id\"\n", "holds identities, which are never filtered"},
      {"albedo = \"albedo\"\n", "the map has no 'color'"},
      {"color = \"\"\nsamples = 0\n", "'samples' is out of range"},
      {"color = \"\"\nvariance = \"albedo\"\nvariance_is = \"men\"\n",
       "'variance_is' cannot be 'men'; did you mean 'mean'?"},
      {"color = \"\"\nvariance_is = \"mean\"\n", "'variance_is' stands without 'variance'"},
      {"color = \"\"\nhalves = [\"albedo\"]\n", "'halves' are not two"},
      {"color = \"\"\n[[passes]]\nindirect = true\n", "a pass has no 'layer'"},
      {"color = \"\"\n[[passes]]\nlayer = \"\"\n", "a pass is the picture itself"},
      {"color = \"\"\n[[passes]]\nlayer = \"albedo\"\n[[passes]]\nlayer = \"albedo\"\n", "a pass is named twice"},
      {"color = \"\n", "layers.toml"},
  };
  for (const auto& [map, message] : mistakes) {
    test::write_file(path("layers.toml"), map);
    const std::string said = refused("-f bilateral --map " + path("layers.toml"));
    EXPECT_TRUE(holds(said, message)) << said;
    EXPECT_TRUE(holds(said, "layers.toml")) << said;
  }
  EXPECT_TRUE(holds(refused("--map " + path("none.toml")), "none.toml: no such file"));
}

TEST_F(Frames, DamagedFilesAreRefused) {
  test::write_file(in, "");
  EXPECT_TRUE(holds(refused(), "is empty, 0 bytes"));
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  const std::string bytes = test::read_file(in);
  for (const size_t size : {bytes.size() / 10, bytes.size() / 2, bytes.size() - 5}) {
    test::write_file(in, bytes.substr(0, size));
    const std::string said = refused();
    EXPECT_TRUE(holds(said, "shot.exr")) << said;
  }
}

TEST_F(Frames, TheInputIsNeverWrittenOver) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  const std::string bytes = test::read_file(in);
  const auto r = run_brume("denoise " + in + " -o " + in + " -f bilateral");
  EXPECT_EQ(r.status, 2);
  EXPECT_TRUE(holds(r.err, "would be destroyed")) << r.err;
  EXPECT_EQ(test::read_file(in), bytes);
}

TEST_F(Frames, WholeNumbersAreNoLight) {
  write({{header_of({":RGB"}, Imf::UINT), [](const std::string&, int, int) { return 3.0; }}});
  EXPECT_TRUE(holds(refused(), "channel B holds whole numbers"));
}

TEST_F(Frames, BrumesOwnFramesAreKeptWhereAsked) {
  write_exr(in, test::noisy_frame(kWidth, kHeight, 3));
  denoise("-f bilateral");
  EXPECT_EQ(read_exr(out).find("gradient.X"), nullptr) << "as ever";
  const std::string said = denoise("-f bilateral --keep-file");
  expect_kept_but({"", "direct", "indirect"});
  EXPECT_TRUE(holds(said, "RGB = direct + indirect")) << said;
  EXPECT_FALSE(holds(said, "no variance in the file for direct, indirect")) << said;
  const Layers frame = read_exr(out);
  EXPECT_EQ(frame.at("R")(4, 4), frame.at("direct.R")(4, 4) + frame.at("indirect.R")(4, 4));
}

TEST_F(Frames, SequencesAreCleanedFrameByFrame) {
  for (const int number : {1, 2, 3}) {
    Imf::Header header = header_of({"V.Combined:RGBA", "V.VolumeDir:RGB", "flash:RGB"}, Imf::FLOAT);
    test::write_exr_file(path("shot.000" + std::to_string(number) + ".exr"), {{header, noisy}});
  }
  in = path("shot.0002.exr");
  denoise("-f virtual_flash:guide=signal --noise spatial --extra-frames 1");
  expect_kept_but({"V.Combined", "V.VolumeDir"});
  test::write_exr_file(path("shot.0003.exr"), {{header_of({"W.Combined:RGBA", "flash:RGB"}, Imf::FLOAT), noisy}});
  std::filesystem::remove(out);
  EXPECT_TRUE(holds(refused("-f virtual_flash:guide=signal --noise spatial --extra-frames 1"),
                    "shot.0003.exr: has no picture Blender Cycles multilayer 'V'"));
}

TEST_F(Frames, InfoSaysWhatIsRecognised) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  const auto r = run_brume("info " + in);
  EXPECT_TRUE(holds(
      r.out,
      "read as Blender Cycles multilayer 'My Layer': Combined; passes VolumeDir; VolumeInd; Env; Emit; features albedo; depth; 8 samples per pixel"))
      << r.out;
  const auto j = nlohmann::json::parse(run_brume("info --json " + in).out);
  EXPECT_EQ(j["pictures"][0]["passes"][1]["name"], "VolumeInd");
  EXPECT_EQ(j["pictures"][0]["samples"], 8.0);
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

/// What a program says on stdout; its exit status must be 0.
std::string said_by(const std::string& command) {
  std::string text;
  FILE* const pipe = popen(command.c_str(), "r");
  char buffer[4096];
  while (const size_t count = std::fread(buffer, 1, sizeof(buffer), pipe)) text.append(buffer, count);
  EXPECT_EQ(pclose(pipe), 0) << command << "\n" << text;
  return text;
}

// An independent reader: the same channels and attributes but ours, and no difference in what was not cleaned.
TEST_F(Frames, OpenImageIOFindsNothingElseChanged) {
  if (std::system("command -v oiiotool >/dev/null") != 0) GTEST_SKIP() << "oiiotool (openimageio-tools) is not there";
  for (const Imf::PixelType type : {Imf::HALF, Imf::FLOAT}) {
    write({{cycles_header(type), cycles_value}});
    denoise();
    const auto lines = [&](const std::string& path) {
      std::istringstream all(said_by("oiiotool --info -v " + path));
      std::set<std::string> kept;
      for (std::string line; std::getline(all, line);)
        if (!holds(line, path) && !holds(line, " brume.")) kept.insert(line);
      return kept;
    };
    EXPECT_EQ(lines(in), lines(out));
    std::string untouched;
    for (const ExrInfo::Channel& c : read_exr_info(in).channels)
      if (!holds(c.name, "Volume") && !holds(c.name, "Env") && (!holds(c.name, "Combined") || c.name.ends_with("A")))
        untouched += (untouched.empty() ? "" : ",") + c.name;
    const std::string chosen = " --ch \"" + untouched + "\" ";
    EXPECT_TRUE(holds(said_by("oiiotool " + in + chosen + out + chosen + "--fail 0 --warn 0 --diff"), "PASS"));
  }
}

TEST_F(Frames, CieXyzIsCleanedAsColoursAndComesBackAsXyz) {
  const auto xyz = [](const std::string& channel, int x, int y) {
    return (channel == "X" ? 0.95 : channel == "Y" ? 1.0 : 1.09) * noisy("grey", x, y);
  };
  Imf::Header header = test::exr_header(kWidth, kHeight);
  test::add_channels(header, {"X", "Y", "Z"}, Imf::FLOAT);
  write({{header, xyz}});
  EXPECT_TRUE(holds(denoise(), "X Y Z are taken for CIE XYZ colours"));
  expect_kept_but({""}, "XYZ");
  const Layers after = read_exr(out);
  double before_error = 0, after_error = 0, white = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      before_error += std::pow(noisy("grey", x, y) - truth("grey", x, y), 2);
      after_error += std::pow(after.at("Y")(x, y) - truth("grey", x, y), 2);
      white += std::abs(after.at("Z")(x, y) / after.at("Y")(x, y) - 1.09);
    }
  EXPECT_LT(after_error, 0.6 * before_error);
  EXPECT_LT(white / (kWidth * kHeight), 1e-3);

  std::filesystem::remove(out);
  write({{header, [](const std::string&, int x, int) { return x - 10.0; }}});
  EXPECT_TRUE(holds(refused(), "X Y Z are negative in 33 % of the pixels, as positions"));
}

TEST_F(Frames, RadianceAndFloatMapsAreCleanedToExr) {
  Layers picture(kWidth, kHeight);
  const auto planes = picture.add_rgb(layer::beauty);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (Plane* plane : planes) (*plane)(x, y) = static_cast<float>(noisy("grey", x, y));
  const RgbPlanes written = {planes[0], planes[1], planes[2]};
  in = path("frame.pfm");
  write_pfm(in, written);
  denoise();
  std::string bytes = fmt::format("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n", kHeight, kWidth);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      int exponent = 0;
      const auto mantissa = static_cast<char>(static_cast<int>(256 * std::frexp((*planes[0])(x, y), &exponent)));
      bytes += {mantissa, mantissa, mantissa, static_cast<char>(128 + exponent)};
    }
  const Layers of_map = read_exr(out);
  in = path("frame.hdr");
  test::write_file(in, bytes);
  denoise();
  const Layers of_radiance = read_exr(out);
  double before = 0, after = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      before += std::pow((*planes[0])(x, y) - truth("grey", x, y), 2);
      after += std::pow(of_map.at("R")(x, y) - truth("grey", x, y), 2);
      EXPECT_NEAR(of_radiance.at("R")(x, y), of_map.at("R")(x, y), 0.02);
    }
  EXPECT_LT(after, 0.6 * before);
  EXPECT_TRUE(holds(run_brume("info " + in).out, "RGB"));
}

TEST_F(Frames, OptionsThatMakeNoSenseAreRefused) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  EXPECT_TRUE(
      holds(refused("-f bilateral --carry direct"), "--carry: the passes of this frame are cleaned by themselves"));
  EXPECT_TRUE(holds(refused("-f bilateral --suffix ._"), "expected letters or digits"));
  write({{header_of({"V.Combined:RGBA"}, Imf::FLOAT), noisy}});
  EXPECT_TRUE(
      holds(refused("-f bilateral --component indirect"), "no pass is known to be light scattered more than once"));
}

}  // namespace
}  // namespace brume
