// Files are written again with some channels replaced: all else is compared bit by bit, attribute by attribute.

#include "image/exr_copy.h"

#include <ImfChannelList.h>
#include <ImfChromaticitiesAttribute.h>
#include <ImfKeyCodeAttribute.h>
#include <ImfMatrixAttribute.h>
#include <ImfOpaqueAttribute.h>
#include <ImfPartType.h>
#include <ImfPreviewImageAttribute.h>
#include <ImfRationalAttribute.h>
#include <ImfStringAttribute.h>
#include <ImfStringVectorAttribute.h>
#include <ImfTimeCodeAttribute.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "image/exr_io.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

using test::exr_bits;
using test::ExrPart;

double noise(const std::string& channel, int x, int y) {
  return 100 * test::chance(x, y, std::hash<std::string>()(channel));
}

/// A copy of `from` in which `channels` have new values, in the frame that read_exr gives.
ExrCopyReport copy_with(const std::filesystem::path& from, const std::filesystem::path& to,
                        const std::vector<std::string>& channels, float value = 0.1f, const std::string& beside = "") {
  const Layers frame = read_exr(from);
  const Plane plane(frame.width(), frame.height(), value);
  std::vector<ExrEdit> edits;
  for (const std::string& c : channels)
    edits.push_back({c, &plane, frame.data_window(), beside.empty() ? "" : beside + c});
  return copy_exr(from, to, edits);
}

std::set<std::string> with_levels(const std::set<std::string>& names,
                                  const std::map<std::string, test::ExrBits>& bits) {
  std::set<std::string> all;
  for (const auto& [name, values] : bits)
    if (names.contains(name.substr(0, name.rfind('/')))) all.insert(name);
  return all;
}

void expect_kept_but(const std::filesystem::path& from, const std::filesystem::path& to,
                     const std::set<std::string>& changed) {
  EXPECT_EQ(test::exr_channels(from), test::exr_channels(to));
  EXPECT_EQ(test::differing(test::exr_attributes(from), test::exr_attributes(to)), std::set<std::string>());
  const auto before = exr_bits(from), after = exr_bits(to);
  EXPECT_EQ(test::differing(before, after), with_levels(changed, before));
}

Imf::Header mixed_header(int width, int height) {
  Imf::Header header = test::exr_header(width, height);
  test::add_channels(header, test::channels_of(""), Imf::HALF);
  test::add_channels(header, {"depth.Z", "a layer with a name of more than thirty-one letters.X"}, Imf::FLOAT);
  test::add_channels(header, {"id"}, Imf::UINT);
  return header;
}

class CopiedExr : public testing::Test {
 protected:
  test::TemporaryFolder folder_;
  std::filesystem::path from = folder_ / "from.exr", to = folder_ / "to.exr";
};

TEST_F(CopiedExr, UntouchedChannelsKeepTheirBitsInEveryCompressionWithoutLoss) {
  for (const Imf::Compression compression : {Imf::NO_COMPRESSION, Imf::RLE_COMPRESSION, Imf::ZIPS_COMPRESSION,
                                             Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION, Imf::PXR24_COMPRESSION})
    for (const Imf::LineOrder order : {Imf::INCREASING_Y, Imf::DECREASING_Y}) {
      Imf::Header header = mixed_header(13, 300);
      header.compression() = compression;
      header.lineOrder() = order;
      test::write_exr_file(from, {{header, noise}});
      EXPECT_TRUE(copy_with(from, to, {"G"}).recoded.empty());
      expect_kept_but(from, to, {"/G"});
    }
}

TEST_F(CopiedExr, ValuesAreRoundedToHalfAndNeverToInfinity) {
  test::write_exr_file(from, {{mixed_header(4, 3), noise}});
  copy_with(from, to, {"R", "depth.Z"}, 1e6f);
  const Layers back = read_exr(to);
  EXPECT_EQ(back.at("R")(1, 1), 65504.0f);
  EXPECT_EQ(back.at("depth.Z")(1, 1), 1e6f);
  copy_with(from, to, {"R", "depth.Z"}, 0.1f);
  Plane rounded(1, 1, 0.1f);
  round_to_half(rounded);
  EXPECT_EQ(read_exr(to).at("R")(1, 1), rounded(0, 0));
  EXPECT_NE(rounded(0, 0), 0.1f);
}

TEST_F(CopiedExr, NaNsOfOtherChannelsKeepTheirPayload) {
  const auto odd = [](const std::string&, int x, int y) {
    return x == y ? std::numeric_limits<double>::quiet_NaN() : -std::numeric_limits<double>::infinity();
  };
  Imf::Header header = test::exr_header(6, 6);
  test::add_channels(header, test::channels_of(""), Imf::HALF);
  test::write_exr_file(from, {{header, odd}});
  copy_with(from, to, {"R"});
  expect_kept_but(from, to, {"/R"});
}

TEST_F(CopiedExr, EveryKindOfAttributeSurvives) {
  Imf::Header header = mixed_header(8, 8);
  header.pixelAspectRatio() = 1.5f;
  header.screenWindowCenter() = Imath::V2f(0.25f, -1);
  header.screenWindowWidth() = 3;
  header.insert("key", Imf::KeyCodeAttribute(Imf::KeyCode(1, 2, 3, 4, 5)));
  header.insert("time", Imf::TimeCodeAttribute(Imf::TimeCode(1, 2, 3, 4)));
  header.insert("rate", Imf::RationalAttribute(Imf::Rational(24000, 1001)));
  header.insert("colours", Imf::ChromaticitiesAttribute());
  header.insert("matrix", Imf::M33dAttribute(Imath::M33d(1, 2, 3, 4, 5, 6, 7, 8, 9)));
  header.insert("views", Imf::StringVectorAttribute({"left", "right"}));
  header.insert("preview", Imf::PreviewImageAttribute(Imf::PreviewImage(2, 2)));
  header.insert("cryptomatte/2ca5e78/manifest", Imf::StringAttribute("{\"Vol\":\"922c1ccd\"}"));
  header.insert("of nobody's kind", Imf::OpaqueAttribute("studioSecret"));
  test::write_exr_file(from, {{header, noise}});
  ASSERT_EQ(test::exr_attributes(from).count("/of nobody's kind"), 1u);
  copy_with(from, to, {"R"});
  expect_kept_but(from, to, {"/R"});
  const Plane plane(8, 8);
  const ExrEdit edit{"R", &plane, {{0, 0}, {8, 8}}};
  copy_exr(from, to, std::span(&edit, 1), {{"brume.filter", std::string("sbf")}});
  EXPECT_EQ(test::differing(test::exr_attributes(from), test::exr_attributes(to)),
            std::set<std::string>{"/brume.filter"});
}

TEST_F(CopiedExr, DataWindowsUnlikeDisplayWindowsSurvive) {
  Imf::Header header = mixed_header(20, 10);
  header.dataWindow() = Imath::Box2i(Imath::V2i(-3, 4), Imath::V2i(25, 7));
  test::write_exr_file(from, {{header, noise}});
  const Layers frame = read_exr(from);
  Plane numbered(29, 4);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 29; ++x) numbered(x, y) = static_cast<float>(100 * (y + 4) + x - 3);
  const ExrEdit edit{"depth.Z", &numbered, frame.data_window()};
  copy_exr(from, to, std::span(&edit, 1));
  expect_kept_but(from, to, {"/depth.Z"});
  EXPECT_EQ(read_exr(to).at("depth.Z")(28, 3), 725.0f);
}

TEST_F(CopiedExr, PartsKeepOrderNamesAndWindowsAndOthersAreNotUnpacked) {
  std::vector<ExrPart> parts;
  for (const char* name : {"rgba", "crypto", "depth"}) {
    Imf::Header header = test::exr_header(32, 24);
    header.setName(name);
    header.compression() = std::string(name) == "crypto" ? Imf::B44_COMPRESSION : Imf::ZIP_COMPRESSION;
    test::add_channels(header, test::channels_of(""), Imf::HALF);
    if (std::string(name) == "depth") header.dataWindow() = Imath::Box2i(Imath::V2i(5, 6), Imath::V2i(20, 9));
    parts.push_back({header, noise});
  }
  parts[2].header.setTileDescription(Imf::TileDescription(8, 8));
  test::write_exr_file(from, parts);
  EXPECT_TRUE(copy_with(from, to, {"rgba.R", "depth.B"}).recoded.empty()) << "the part that loses bits is not touched";
  expect_kept_but(from, to, {"rgba/R", "depth/B"});
}

TEST_F(CopiedExr, FloatsThatLoseBitsAreNamed) {
  Imf::Header header = mixed_header(8, 8);
  header.compression() = Imf::PXR24_COMPRESSION;
  test::write_exr_file(from, {{header, noise}});
  EXPECT_TRUE(copy_with(from, to, {"R"}).rounded.empty()) << "half values are kept whole";
  EXPECT_EQ(copy_with(from, to, {"depth.Z"}).rounded, std::vector<std::string>{"its only part"});
}

TEST_F(CopiedExr, LossyPartsThatAreTouchedAreNamed) {
  for (const Imf::Compression compression :
       {Imf::B44_COMPRESSION, Imf::B44A_COMPRESSION, Imf::DWAA_COMPRESSION, Imf::DWAB_COMPRESSION}) {
    Imf::Header header = mixed_header(40, 40);
    header.compression() = compression;
    test::write_exr_file(from, {{header, noise}});
    EXPECT_EQ(copy_with(from, to, {"R"}).recoded, std::vector<std::string>{"its only part"});
    EXPECT_EQ(test::differing(test::exr_attributes(from), test::exr_attributes(to)), std::set<std::string>());
    const auto changed = test::differing(exr_bits(from), exr_bits(to));
    EXPECT_FALSE(changed.contains("/id/0,0")) << "whole numbers are packed without loss";
  }
}

// Each mode of levels and rounding; levels of odd sizes.
TEST_F(CopiedExr, TilesAndTheirResolutionLevelsSurvive) {
  for (const Imf::LevelMode mode : {Imf::ONE_LEVEL, Imf::MIPMAP_LEVELS, Imf::RIPMAP_LEVELS})
    for (const Imf::LevelRoundingMode rounding : {Imf::ROUND_DOWN, Imf::ROUND_UP})
      for (const Imf::LineOrder order : {Imf::INCREASING_Y, Imf::DECREASING_Y, Imf::RANDOM_Y}) {
        Imf::Header header = mixed_header(37, 21);
        header.setTileDescription(Imf::TileDescription(16, 8, mode, rounding));
        header.lineOrder() = order;
        test::write_exr_file(from, {{header, noise}});
        copy_with(from, to, {"depth.Z"});
        expect_kept_but(from, to, {"/depth.Z"});
        for (const auto& [name, bits] : exr_bits(to))
          if (name.starts_with("/depth.Z/")) {
            EXPECT_EQ(std::bit_cast<float>(bits.front()), 0.1f) << name;
            EXPECT_EQ(std::bit_cast<float>(bits.back()), 0.1f) << name;
          }
      }
}

TEST_F(CopiedExr, LowerLevelsAreMeansOfWhatTheyCover) {
  Imf::Header header = test::exr_header(4, 4);
  test::add_channels(header, {"Y"}, Imf::FLOAT);
  header.setTileDescription(Imf::TileDescription(4, 4, Imf::MIPMAP_LEVELS));
  test::write_exr_file(from, {{header, noise}});
  Plane values(4, 4);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 4; ++x) values(x, y) = static_cast<float>(x + 10 * y);
  const ExrEdit edit{"Y", &values, {{0, 0}, {4, 4}}};
  copy_exr(from, to, std::span(&edit, 1));
  const auto bits = exr_bits(to);
  EXPECT_EQ(std::bit_cast<float>(bits.at("/Y/1,1")[3]), (22 + 23 + 32 + 33) / 4.0f);
  EXPECT_EQ(std::bit_cast<float>(bits.at("/Y/2,2")[0]), 16.5f);
}

TEST_F(CopiedExr, NewChannelsStandBesideTheOld) {
  test::write_exr_file(from, {{mixed_header(5, 5), noise}});
  copy_with(from, to, {"R", "depth.Z"}, 0.5f, "clean.");
  const auto before = exr_bits(from), after = exr_bits(to);
  EXPECT_EQ(test::differing(before, after), (std::set<std::string>{"/clean.R/0,0", "/clean.depth.Z/0,0"}));
  EXPECT_EQ(read_exr(to).at("clean.R")(2, 2), 0.5f);
  for (const ExrInfo::Channel& c : read_exr_info(to).channels)
    if (c.name == "clean.R") {
      EXPECT_EQ(c.type, "half") << "as the channel that it is made of";
    }
  test::write_file(from, test::read_file(to));
  try {
    copy_with(from, to, {"R"}, 0.5f, "clean.");
    FAIL() << "a name was given twice";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("another suffix"), std::string::npos) << error.what();
  }
}

// Luminance and chroma at half resolution, as OpenEXR's own library writes photographs.
TEST_F(CopiedExr, LuminanceAndChromaAreReadAsColoursAndWrittenBack) {
  Imf::Header header = test::exr_header(16, 12);
  header.channels().insert("Y", Imf::Channel(Imf::HALF));
  header.channels().insert("RY", Imf::Channel(Imf::HALF, 2, 2));
  header.channels().insert("BY", Imf::Channel(Imf::HALF, 2, 2));
  header.channels().insert("A", Imf::Channel(Imf::HALF));
  const auto value = [](const std::string& c, int, int) {
    return c == "Y" ? 0.5 : c == "RY" ? 0.25 : c == "BY" ? -0.5 : 1;
  };
  test::write_exr_file(from, {{header, value}});
  const Layers frame = read_exr(from);
  EXPECT_EQ(frame.names(), (std::vector<std::string>{"A", "B", "G", "R"}));
  EXPECT_FLOAT_EQ(frame.at("R")(15, 11), 0.625f);
  EXPECT_FLOAT_EQ(frame.at("B")(15, 11), 0.25f);
  const float green = frame.at("G")(3, 3);
  EXPECT_NEAR(0.2126 * 0.625 + 0.7152 * static_cast<double>(green) + 0.0722 * 0.25, 0.5, 1e-3);
  std::vector<ExrEdit> edits;
  for (const char* c : {"R", "G", "B"}) edits.push_back({c, &frame.at(c), frame.data_window()});
  copy_exr(from, to, edits);
  EXPECT_EQ(test::exr_channels(from), test::exr_channels(to));
  const auto before = exr_bits(from), after = exr_bits(to);
  EXPECT_EQ(before.at("/A/0,0"), after.at("/A/0,0"));
  for (const char* name : {"/Y/0,0", "/RY/0,0", "/BY/0,0"})
    for (size_t i = 0; i < before.at(name).size(); ++i)
      EXPECT_LE(std::abs(static_cast<int>(before.at(name)[i]) - static_cast<int>(after.at(name)[i])), 1) << name;
}

TEST_F(CopiedExr, SubsampledChannelsOfOtherKindsAreSpreadAndKept) {
  Imf::Header header = test::exr_header(10, 8);
  header.channels().insert("R", Imf::Channel(Imf::FLOAT));
  header.channels().insert("coarse.X", Imf::Channel(Imf::FLOAT, 5, 2));
  test::write_exr_file(from, {{header, [](const std::string&, int x, int y) { return x + 10.0 * y; }}});
  const Layers frame = read_exr(from);
  EXPECT_FLOAT_EQ(frame.at("coarse.X")(2, 1), 12.0f) << "linear in between";
  EXPECT_FLOAT_EQ(frame.at("coarse.X")(9, 7), 65.0f) << "constant after the last";
  copy_with(from, to, {"R"});
  expect_kept_but(from, to, {"/R"});
}

TEST_F(CopiedExr, DeepPartsAreRefusedByName) {
  test::write_deep_exr(from);
  const auto refused = [&](const auto& work) {
    try {
      work();
      ADD_FAILURE() << "deep pixels were taken";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("part 'smoke' holds deep pixels"), std::string::npos) << error.what();
    }
  };
  refused([&] { read_exr(from); });
  refused([&] { copy_exr(from, to, {}); });
  EXPECT_FALSE(std::filesystem::exists(to));
}

TEST_F(CopiedExr, DamagedFilesLeaveNothingBehind) {
  test::write_exr_file(from, {{mixed_header(64, 64), noise}});
  const Plane plane(64, 64);
  const ExrEdit edit{"R", &plane, {{0, 0}, {64, 64}}};
  const std::string bytes = test::read_file(from);
  for (const size_t size : {size_t{0}, size_t{100}, bytes.size() / 2, bytes.size() - 1}) {
    test::write_file(from, bytes.substr(0, size));
    EXPECT_THROW(copy_exr(from, to, std::span(&edit, 1)), InputError) << size;
    EXPECT_FALSE(std::filesystem::exists(to)) << size;
    EXPECT_FALSE(test::has_half_written(to.parent_path())) << size;
  }
}

TEST_F(CopiedExr, AFullDiskIsAnErrorAndLeavesNothing) {
  test::write_exr_file(from, {{mixed_header(64, 64), noise}});
  const test::FullDisk full(to);
  EXPECT_THROW(copy_with(from, to, {"R"}), InputError);
  EXPECT_FALSE(std::filesystem::exists(to));
}

TEST_F(CopiedExr, ItStopsWhenAsked) {
  test::write_exr_file(from, {{mixed_header(64, 64), noise}});
  const std::atomic<bool> cancel{true};
  const Plane plane(64, 64);
  const ExrEdit edit{"R", &plane, {{0, 0}, {64, 64}}};
  EXPECT_THROW(copy_exr(from, to, std::span(&edit, 1), {}, {1, {}, &cancel}), Interrupted);
  EXPECT_FALSE(std::filesystem::exists(to));
}

TEST_F(CopiedExr, WhatIsNotThereOrNoLightIsNotEdited) {
  test::write_exr_file(from, {{mixed_header(4, 4), noise}});
  EXPECT_THROW(copy_with(from, to, {"no such"}), std::logic_error);
  EXPECT_THROW(copy_with(from, to, {"id"}), std::logic_error);
}

}  // namespace
}  // namespace brume
