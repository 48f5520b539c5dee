// Names with a frame's number in them, and lists of frames.

#include "base/sequence.h"

#include <gtest/gtest.h>

#include "base/error.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using Frames = std::vector<int>;

std::string file(const std::string& name, int frame) {
  return FramePattern::of(name).value().path(frame).string();
}

TEST(FramePattern, EveryWayOfWritingANumberIsRead) {
  EXPECT_EQ(file("shot.####.exr", 7), "shot.0007.exr");
  EXPECT_EQ(file("shot.#.exr", 12), "shot.12.exr");
  EXPECT_EQ(file("shot.$F.exr", 7), "shot.7.exr");
  EXPECT_EQ(file("shot.$F4.exr", 7), "shot.0007.exr");
  EXPECT_EQ(file("shot_${F3}a.exr", 7), "shot_007a.exr");
  EXPECT_EQ(file("shot_${F}2.exr", 7), "shot_72.exr");
  EXPECT_EQ(file("shot.%04d.exr", 7), "shot.0007.exr");
  EXPECT_EQ(file("shot.%d.exr", 7), "shot.7.exr");
  EXPECT_EQ(file("shot.@@@@.exr", 7), "shot.0007.exr");
  EXPECT_EQ(file("shot.<F4>.exr", 7), "shot.0007.exr");
  EXPECT_EQ(file("shot.<f>.exr", 7), "shot.7.exr");
  EXPECT_EQ(file("shot.<frame>.exr", 7), "shot.7.exr");
  EXPECT_EQ(file("$F4/shot.##.exr", 7), "0007/shot.07.exr") << "at several places, in folders too";
}

TEST(FramePattern, ANumberWithMoreDigitsThanItsPlaceIsWrittenInFull) {
  EXPECT_EQ(file("shot.##.exr", 1234), "shot.1234.exr");
}

TEST(FramePattern, OtherNamesAreNone) {
  for (const char* name :
       {"shot.0007.exr", "", "$FF.exr", "$FPS.exr", "100%.exr", "%s.exr", "%4d.exr", "${F4.exr", "$f4.exr", "F4.exr",
        "icon@2x.exr", "a@b.exr", "<F4.exr", "<UDIM>.exr", "<frames>.exr", "<Fx>.exr"})
    EXPECT_FALSE(FramePattern::of(name)) << name;
  EXPECT_EQ(file_of_frame("smoke.vdb", 7), "smoke.vdb");
  EXPECT_EQ(file_of_frame("smoke.$F4.vdb", 7), "smoke.0007.vdb");
}

TEST(FramePattern, TooManyDigitsAreRefused) {
  for (const char* name : {"s.##########.exr", "s.$F10.exr", "s.%010d.exr", "s.@@@@@@@@@@.exr", "s.<F10>.exr",
                           "s.${F99999999999999999999}.exr"})
    try {
      FramePattern::of(name);
      ADD_FAILURE() << name;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("digits; a frame's number has at most 9"), std::string::npos)
          << error.what();
    }
}

TEST(FramesOrAll, ANameWithAPlaceStandsForAllThatAreThere) {
  const test::TemporaryFolder folder;
  for (const char* name : {"s.0010.exr", "s.0002.exr", "take#2.exr"}) test::write_file(folder / name, "");
  EXPECT_EQ(frames_or_all_of(folder / "s.####.exr"), (Frames{2, 10}));
  EXPECT_EQ(frames_or_all_of(folder / "s.####.exr", "3-4"), (Frames{3, 4})) << "what is asked for, there or not";
  EXPECT_TRUE(frames_or_all_of(folder / "s.0002.exr").empty());
  EXPECT_TRUE(frames_or_all_of(folder / "take#2.exr").empty()) << "a file is itself";
  EXPECT_TRUE(frames_or_all_of(folder / "none.####.exr").empty());
}

TEST(FramePattern, FindsTheFramesThatThereAre) {
  const test::TemporaryFolder folder;
  for (const char* name : {"s.0010.exr", "s.0002.exr", "s.12345.exr", "s.002.exr", "s.00002.exr", "s.0003.exr.part",
                           "t.0004.exr", "s.x.exr", "s..exr", "s.99999999999.exr"})
    test::write_file(folder / name, "");
  EXPECT_EQ(FramePattern::of(folder / "s.####.exr")->frames_on_disk(), (Frames{2, 10, 12345}));
  EXPECT_EQ(FramePattern::of(folder / "s.$F.exr")->frames_on_disk(), Frames{12345}) << "none has leading zeros";
  EXPECT_TRUE(FramePattern::of(folder / "nowhere/s.####.exr")->frames_on_disk().empty());
  std::filesystem::create_directory(folder / "0007");
  std::filesystem::create_directory(folder / "0008");
  test::write_file(folder / "0007/a_7.exr", "");
  test::write_file(folder / "0008/a_7.exr", "");
  EXPECT_EQ(FramePattern::of(folder / "####/a_$F.exr")->frames_on_disk(), Frames{7}) << "both numbers are the frame's";
}

TEST(Frames, RangesStepsAndListsAreRead) {
  EXPECT_EQ(parse_frames("7"), Frames{7});
  EXPECT_EQ(parse_frames("0"), Frames{0});
  EXPECT_EQ(parse_frames("1-4"), (Frames{1, 2, 3, 4}));
  EXPECT_EQ(parse_frames("1-8x3"), (Frames{1, 4, 7}));
  EXPECT_EQ(parse_frames("3x2"), Frames{3});
  EXPECT_EQ(parse_frames("20, 1-3,2-4"), (Frames{1, 2, 3, 4, 20})) << "rising, each once";
  EXPECT_EQ(parse_frames("0001-0003"), (Frames{1, 2, 3}));
  EXPECT_EQ(parse_frames("1-240").size(), 240u);
}

TEST(Frames, WhatIsWrongIsSaid) {
  const std::pair<const char*, const char*> cases[] = {{"", "a frame is missing"},
                                                       {"1,,2", "a frame is missing"},
                                                       {"1-", "'1-' breaks off"},
                                                       {"a", "'a' is not a number"},
                                                       {"-5", "'-5' is below 0"},
                                                       {"-5-3", "'-5-3' is below 0"},
                                                       {"1--3", "'-3' is not a number"},
                                                       {"5-1", "'5-1' ends before it begins"},
                                                       {"1-9x0", "'1-9x0' has a step of 0"},
                                                       {"1-9y", "'1-9y' goes on with 'y'"},
                                                       {"1-1000000000", "a number above 999999999"},
                                                       {"0-999999999", "makes them more than 10000000"}};
  for (const auto& [text, found] : cases) try {
      parse_frames(text);
      ADD_FAILURE() << text;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(found), std::string::npos) << error.what();
    }
}

TEST(Frames, AreToldAsRanges) {
  EXPECT_EQ(frames_text(Frames{1, 2, 3, 7, 9, 10}), "1-3, 7, 9-10");
  EXPECT_EQ(frames_text({}), "");
}

}  // namespace
}  // namespace brume
