#include "image/hdr_io.h"

#include <gtest/gtest.h>

#include <atomic>

#include "base/error.h"
#include "tests/support/files.h"

namespace brume {
namespace {

const std::string kHeader = "#?RADIANCE\n# a comment\nFORMAT=32-bit_rle_rgbe\n\n";

class Hdr : public ::testing::Test {
 protected:
  Layers read(const std::string& bytes, const Task& task = {}, std::vector<std::string>* notes = nullptr) const {
    test::write_file(folder_ / "a.hdr", bytes);
    return read_hdr(folder_ / "a.hdr", task, notes);
  }
  std::string error_of(const std::string& bytes) const {
    try {
      read(bytes);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  void expect_refused(const std::string& bytes, const std::string& part) const {
    const std::string error = error_of(bytes);
    EXPECT_NE(error.find("a.hdr: " + part), std::string::npos) << error;
  }
  test::TemporaryFolder folder_;
};

std::string bytes_of(std::initializer_list<int> values) {
  std::string bytes;
  for (const int value : values) bytes += static_cast<char>(value);
  return bytes;
}

TEST_F(Hdr, AValueIsItsMantissaTimesAPowerOfTwo) {
  const Layers picture =
      read(kHeader + "-Y 2 +X 2\n" + bytes_of({128, 64, 0, 128, 255, 1, 2, 136, 9, 9, 9, 0, 3, 5, 7, 129}));
  EXPECT_EQ(picture.at("R")(0, 0), 0.5f);
  EXPECT_EQ(picture.at("G")(0, 0), 0.25f);
  EXPECT_EQ(picture.at("R")(1, 0), 255.0f);
  EXPECT_EQ(picture.at("B")(0, 1), 0.0f) << "an exponent of 0 is black";
  EXPECT_EQ(picture.at("B")(1, 1), 7.0f / 128);
}

TEST_F(Hdr, RunsOfBothKindsAreUnpacked) {
  // The new kind: each of the four bytes by itself, runs (above 128) and stretches of different values.
  const Layers modern =
      read(kHeader + "-Y 1 +X 8\n" + bytes_of({2, 2, 0, 8, 136, 40, 3, 1, 2, 3, 133, 4, 136, 0, 130, 136, 134, 137}));
  const float red[] = {40, 40, 40, 40, 40, 40, 40, 40}, green[] = {1, 2, 3, 4, 4, 4, 4, 4};
  for (int x = 0; x < 8; ++x) {
    const float scale = x < 2 ? 1.0f : 2.0f;
    EXPECT_EQ(modern.at("R")(x, 0), red[x] * scale);
    EXPECT_EQ(modern.at("G")(x, 0), green[x] * scale);
    EXPECT_EQ(modern.at("B")(x, 0), 0.0f);
  }
  // The old kind: 1, 1, 1, n repeats the last pixel n times, a second one right after it 256 n times.
  const Layers old = read(kHeader + "-Y 1 +X 260\n" + bytes_of({7, 8, 9, 136, 1, 1, 1, 2, 1, 1, 1, 1, 5, 5, 5, 136}));
  for (int x = 0; x < 259; ++x) ASSERT_EQ(old.at("G")(x, 0), 8.0f) << x;
  EXPECT_EQ(old.at("G")(259, 0), 5.0f);
}

TEST_F(Hdr, WhatItDoesNotReadItNames) {
  const std::string pixels(64, 'x');
  expect_refused("P6 1 1 255\n", "not a Radiance HDR file");
  expect_refused("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\nxxxx",
                 "its format is '32-bit_rle_xyze', luminances in CIE XYZ");
  expect_refused("#?RADIANCE\nFORMAT=32-bit_rle_xyz\n\n-Y 1 +X 1\nxxxx", "its format is '32-bit_rle_xyz'");
  expect_refused(kHeader + "+Z 4 +X 4\n" + pixels, "its resolution line is '+Z 4 +X 4'; expected '-Y height +X width'");
  expect_refused(kHeader + "+X 4 -X 4\n" + pixels, "its resolution line is '+X 4 -X 4'");
  for (const char* line : {"EXPOSURE=0", "EXPOSURE=-1", "EXPOSURE=nan", "EXPOSURE=", "COLORCORR=1 1 0", "COLORCORR=1 2",
                           "EXPOSURE=1e31", "EXPOSURE=1e-31", "PRIMARIES=0.64 0.33"})
    EXPECT_NE(error_of(std::string("#?RADIANCE\n") + line + "\n\n-Y 1 +X 1\nxxxx").find(line), std::string::npos)
        << error_of(std::string("#?RADIANCE\n") + line + "\n\n-Y 1 +X 1\nxxxx");
  expect_refused(kHeader + "-Y 4 +X\n" + pixels, "its resolution line is '-Y 4 +X'");
  expect_refused(kHeader + "-Y 0 +X 7\n" + pixels, "is 7 x 0 pixels");
  expect_refused(kHeader + "-Y -3 +X 7\n" + pixels, "is 7 x -3 pixels");
  expect_refused(kHeader + "-Y 65536 +X 65536\n" + pixels, "is 65536 x 65536 pixels");
  expect_refused(kHeader + "-Y 99999999999 +X 1\n" + pixels, "its resolution line is");
  expect_refused(kHeader + "-Y 65536 +X 8\n" + pixels, "truncated: 64 bytes follow its header, too few for 65536 rows");
  expect_refused("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "truncated: the file ends in its header");
  expect_refused("#?RADIANCE\n" + std::string(100000, 'a'), "not a Radiance HDR file: a line of its header has no end");
}

TEST_F(Hdr, ExposuresAreDividedOutAndTold) {
  const std::string pixel = "-Y 1 +X 1\n" + bytes_of({128, 64, 32, 129});
  const auto header = [](const char* lines) { return std::string("#?RADIANCE\n") + lines + "\n"; };
  std::vector<std::string> notes;
  const Layers once = read(header("EXPOSURE=4\n") + pixel, {}, &notes);
  EXPECT_EQ(once.at("R")(0, 0), 0.25f);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("4 times as bright (EXPOSURE)"), std::string::npos) << notes[0];
  const Layers often =
      read(header("EXPOSURE= 2.0\nFORMAT=32-bit_rle_rgbe\npfilt -e 2\nEXPOSURE=2\nCOLORCORR=1 2 0.5\n") + pixel);
  EXPECT_EQ(often.at("R")(0, 0), 0.25f);
  EXPECT_EQ(often.at("G")(0, 0), 0.0625f);
  EXPECT_EQ(often.at("B")(0, 0), 0.125f);
  notes.clear();
  const Layers plain = read(header("EXPOSURE=1\nVIEW= -vtv -vh 45\n") + pixel, {}, &notes);
  EXPECT_EQ(plain.at("R")(0, 0), 1.0f);
  EXPECT_TRUE(notes.empty());
  EXPECT_FALSE(plain.chromaticities());
  const Layers space = read(header("PRIMARIES=0.7 0.29 0.17 0.79 0.13 0.05 0.31 0.33\n") + pixel);
  EXPECT_EQ(space.chromaticities(), (Chromaticities{0.7f, 0.29f, 0.17f, 0.79f, 0.13f, 0.05f, 0.31f, 0.33f}));
}

// Radiance's manual: the axes point right and up, and the first one named is the one of the scan lines.
TEST_F(Hdr, PixelsMayComeInAnyOrder) {
  // Three columns, two rows; red is 1 + the column, green 1 + the row from the top.
  for (const char* const order : {"-Y +X", "+Y +X", "-Y -X", "+Y -X", "+X -Y", "+X +Y", "-X -Y", "-X +Y"}) {
    const std::string first(order, 2), second(order + 3, 2);
    const bool columns = first[1] == 'X';
    const std::string &x_axis = columns ? first : second, &y_axis = columns ? second : first;
    std::string bytes = kHeader + first + (columns ? " 3 " : " 2 ") + second + (columns ? " 2" : " 3") + "\n";
    for (int i = 0; i < (columns ? 3 : 2); ++i)
      for (int j = 0; j < (columns ? 2 : 3); ++j) {
        int x = columns ? i : j, y = columns ? j : i;
        if (x_axis[0] == '-') x = 2 - x;
        if (y_axis[0] == '+') y = 1 - y;
        bytes += bytes_of({1 + x, 1 + y, 0, 136});
      }
    const Layers picture = read(bytes);
    ASSERT_EQ(picture.width(), 3) << order;
    ASSERT_EQ(picture.height(), 2) << order;
    for (int y = 0; y < 2; ++y)
      for (int x = 0; x < 3; ++x) {
        EXPECT_EQ(picture.at("R")(x, y), static_cast<float>(1 + x)) << order;
        EXPECT_EQ(picture.at("G")(x, y), static_cast<float>(1 + y)) << order;
      }
  }
}

TEST_F(Hdr, DamagedRunsAreToldWithTheirRow) {
  const std::string line = bytes_of({2, 2, 0, 8, 136, 1, 136, 1, 136, 1, 136, 128}), head = kHeader + "-Y 2 +X 8\n";
  EXPECT_EQ(error_of(head + line + line), "");
  expect_refused(head + line + bytes_of({2, 2, 0, 9, 137, 1, 137, 1, 137, 1, 137, 1}),
                 "damaged: a scan line of 9 pixels, expected 8, in row 2 of 2");
  expect_refused(head + line + bytes_of({2, 2, 0, 8, 137, 1, 136, 1, 136, 1, 136, 1}),
                 "damaged: 9 values where 8 are left in row 2 of 2");
  expect_refused(head + line + bytes_of({2, 2, 0, 8, 0, 1, 1, 1}), "damaged: 0 values where 8 are left in row 2");
  expect_refused(head + line + bytes_of({1, 1, 1, 3, 9, 9, 9, 9}), "damaged: a run of 3 pixels after 0 of 8 in row 2");
  expect_refused(head + line + line.substr(0, 9), "truncated: the file ends in row 2 of 2");
}

TEST_F(Hdr, ReadingStopsWhenItIsCancelled) {
  const std::atomic<bool> cancel{true};
  EXPECT_THROW(read(kHeader + "-Y 1 +X 1\nxxxx", {1, {}, &cancel}), Interrupted);
}

}  // namespace
}  // namespace brume
