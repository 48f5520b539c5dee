// Parts, views, levels and several pictures in one file: what is cleaned, and that all else comes back.

#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "image/exr_io.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"
#include "tests/support/foreign_frames.h"

namespace brume {
namespace {

using test::channels_of;
using test::ExrPart;
using test::Frames;
using test::header_of;
using test::holds;
using test::kHeight;
using test::kWidth;
using test::noisy;
using test::run_brume;

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

}  // namespace
}  // namespace brume
