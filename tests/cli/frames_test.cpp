// Frames of other renderers through the program: the file that comes back is compared with the one that went in.

#include <ImfChannelList.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

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
#include "tests/support/cycles_frame.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"
#include "tests/support/foreign_frames.h"

namespace brume {
namespace {

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
using test::truth;

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
