// Frames that are looked at: which layers are listed, what of them is shown, lights mixed as `brume mix` does it.

#include "workflows/view/frame_viewer.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "base/error.h"
#include "image/light_layers.h"
#include "tests/support/files.h"
#include "tests/support/holds.h"
#include "tests/support/viewing.h"
#include "workflows/mix_text.h"

namespace brume {
namespace {

using test::holds;
using test::value;

constexpr int kWidth = 12, kHeight = 8;

/// Values that halves hold exactly.
float light(size_t colour, int x, int y, float scale) {
  return scale * static_cast<float>(1 + x + 2 * y + 4 * static_cast<int>(colour)) / 64;
}

void add_colour(Layers& frame, const std::string& layer, float scale) {
  for (size_t c = 0; c < 3; ++c) {
    Plane& plane = frame.add((layer.empty() ? "" : layer + ".") + "RGB"[c]);
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) plane(x, y) = light(c, x, y, scale);
  }
}

/// Brume's: two clean groups of 1 and 2 that make up a picture of 3, with noisy ones of half of that.
Layers own_frame(bool clean_groups = true) {
  Layers frame(kWidth, kHeight);
  add_colour(frame, "", 3);
  add_colour(frame, "noisy", 1.5f);
  add_colour(frame, "direct", 1);
  for (const auto& [group, scale] : {std::pair("key", 1.0f), {"sky", 2.0f}}) {
    if (clean_groups) add_colour(frame, clean_light_layer(group), scale);
    add_colour(frame, light_layer(group), scale / 2);
  }
  Plane& depth = frame.add("depth_mean.Z", 5);
  depth(0, 0) = 1e10f;
  frame.add("A", 0.25f);
  frame.header["software"] = std::string("brume");
  add_matte_layer("CryptoObject", 2, {"Smoke"},
                  std::vector<std::vector<MatteShare>>(kWidth * kHeight, {{matte_id("Smoke"), 0.5f}}), frame);
  return frame;
}

/// Another program's: two groups of 1 and 2 in a picture of 4, of which 1 is of no group.
Layers foreign_frame(const std::string& picture, const std::string& group) {
  Layers frame(kWidth, kHeight);
  add_colour(frame, picture, 4);
  add_colour(frame, group + "key", 1);
  add_colour(frame, group + "rim", 2);
  return frame;
}

class FrameView : public testing::Test {
 protected:
  std::string write(const std::string& name, const Layers& frame) const {
    write_exr(folder_ / name, frame);
    return (folder_ / name).string();
  }
  std::string said_of(const ViewOptions& options) const {
    try {
      check_viewable(options);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }

  test::TemporaryFolder folder_;
};

std::vector<std::string> titles(const ViewedFrame& frame) {
  std::vector<std::string> all;
  for (const ViewSceneText::Layer& layer : frame.layers()) all.push_back(layer.title);
  return all;
}

void expect_scale(const std::optional<ViewPicture>& picture, const dvec3& scale) {
  ASSERT_TRUE(picture);
  ASSERT_EQ(picture->channels, 3);
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < picture->height; ++y)
      for (int x = 0; x < picture->width; ++x)
        ASSERT_NEAR(value(*picture, c, x, y), light(c, x, y, 1) * scale[c], 1e-3) << c << " " << x << " " << y;
}

TEST_F(FrameView, ListsEveryLayerAndMatteOfAFrameByBrume) {
  const ViewedFrame frame(write("own.exr", own_frame()), "");
  EXPECT_EQ(frame.light_groups(), (std::vector<std::string>{"key", "sky"}));
  EXPECT_EQ(titles(frame), (std::vector<std::string>{"picture", "noisy", "alpha", "key", "sky", "key, noisy",
                                                     "sky, noisy", "Smoke", "depth_mean", "direct"}));
}

TEST_F(FrameView, MixesCleanAndNoisyLightAndSaysWhatIsNotMixed) {
  ViewedFrame frame(write("own.exr", own_frame()), "");
  const LightMix mix = {{"key", dvec3(2, 0, 1)}, {"sky", dvec3(0.5)}};
  const ivec2 room(kWidth, kHeight);
  expect_scale(frame.picture("picture", {}, room), dvec3(3));
  expect_scale(frame.picture("picture", mix, room), dvec3(3, 1, 2));
  expect_scale(frame.picture("noisy", mix, room), dvec3(1.5, 0.5, 1));
  expect_scale(frame.picture("light.key", mix, room), dvec3(2, 0, 1));
  const auto direct = frame.picture("direct", mix, room);
  expect_scale(direct, dvec3(1));
  EXPECT_TRUE(direct->misses_mix);
  EXPECT_FALSE(frame.picture("picture", mix, room)->misses_mix);
  EXPECT_FALSE(frame.picture("alpha", mix, room)->misses_mix);
  EXPECT_FALSE(frame.picture("nonsense", mix, room));
}

// As filters leave a frame that clean no groups.
TEST_F(FrameView, ACleanPictureWithNoisyGroupsStaysCleanAndTheNoisyOneIsMixed) {
  ViewedFrame frame(write("own.exr", own_frame(false)), "");
  const LightMix mix = {{"key", dvec3(0)}};
  for (const LightMix& of : {LightMix(), mix}) {
    const auto clean = frame.picture("picture", of, {kWidth, kHeight});
    expect_scale(clean, dvec3(3));
    EXPECT_EQ(clean->misses_mix, !of.empty());
  }
  expect_scale(frame.picture("noisy", {}, {kWidth, kHeight}), dvec3(1.5));
  expect_scale(frame.picture("noisy", mix, {kWidth, kHeight}), dvec3(1));
}

TEST_F(FrameView, TheThirdNumberOfAVectorIsNoDepth) {
  Layers of(kWidth, kHeight);
  for (const char* channel : {"N.X", "N.Y", "N.Z"}) {
    Plane& plane = of.add(channel);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) plane(x, y) = static_cast<float>(x);
  }
  ViewedFrame frame(write("normals.exr", of), "");
  const auto small = frame.picture("N", {}, {kWidth / 2, kHeight});
  for (int c = 0; c < 3; ++c) EXPECT_EQ(value(*small, c, 2, 0), 4.5f) << c;
}

TEST_F(FrameView, ShowsNoMorePixelsThanThereIsRoomForButWholeDepths) {
  ViewedFrame frame(write("own.exr", own_frame()), "");
  const auto small = frame.picture("picture", {{"key", dvec3(0)}}, {kWidth / 2, kHeight});
  ASSERT_EQ(ivec2(small->width, small->height), ivec2(kWidth / 2, kHeight / 2));
  for (int x = 0; x < small->width; ++x)  // means of a ramp
    EXPECT_NEAR(value(*small, 1, x, 1), light(1, 2 * x, 2, 2) + 2 * 1.5 / 64, 1e-3);
  const auto depth = frame.picture("depth_mean.Z", {}, {kWidth / 2, kHeight});
  EXPECT_TRUE(std::isnan(value(*depth, 0, 0, 0))) << "nothing is there";
  EXPECT_EQ(value(*depth, 0, 1, 0), 5);
  const auto matte = frame.picture("matte.CryptoObject.Smoke", {}, {kWidth, kHeight});
  EXPECT_EQ(ivec2(matte->width, matte->height), ivec2(kWidth, kHeight));
  EXPECT_EQ(value(*matte, 0, 3, 3), 0.5f);
}

TEST_F(FrameView, LightGroupsOfOtherRenderersAreMixedAndWhatIsOfNoneStays) {
  const LightMix mix = {{"key", dvec3(0)}, {"rim", dvec3(1, 2, 0.5)}};
  for (const auto& [picture, group] : {std::pair("V.Combined", "V.Combined_"), {"", "RGBA_"}, {"C", "C_"}}) {
    SCOPED_TRACE(group);
    const std::string path = write("other.exr", foreign_frame(picture, group));
    ViewedFrame frame(path, "");
    EXPECT_EQ(frame.light_groups(), (std::vector<std::string>{"key", "rim"}));
    expect_scale(frame.picture("picture", {}, {kWidth, kHeight}), dvec3(4));
    expect_scale(frame.picture("picture", mix, {kWidth, kHeight}), dvec3(3, 5, 2));
    const Layers mixed = mixed_frame(ExrFile(path), "", mix, {});
    for (size_t c = 0; c < 3; ++c) {
      const float whole = c == 0 ? 3.0f : c == 1 ? 5.0f : 2.0f;
      for (const std::string& name : {std::string(), std::string(picture)})
        EXPECT_EQ(mixed.at((name.empty() ? "" : name + ".") + "RGB"[c])(5, 3), light(c, 5, 3, whole));
      EXPECT_EQ(mixed.at(std::string(group) + "key." + "RGB"[c])(5, 3), 0);
    }
  }
}

TEST_F(FrameView, AMapNamesThePictureAndItsLights) {
  const std::string path = write("house.exr", foreign_frame("house_final", "house_"));
  const std::filesystem::path map = folder_ / "map.toml";
  std::ofstream(map) << "color = \"house_final\"\nlights = [\"house_key\", \"house_rim\"]\n";
  ViewedFrame frame(path, map);
  EXPECT_EQ(frame.light_groups(), (std::vector<std::string>{"house_key", "house_rim"}));
  expect_scale(frame.picture("picture", {{"house_rim", dvec3(0)}}, {kWidth, kHeight}), dvec3(2));
  std::ofstream(map) << "color = \"house_finale\"\n";
  EXPECT_TRUE(holds(said_of({.scene = path, .map = map}), "no layer 'house_finale'"));
}

TEST_F(FrameView, WhatCannotBeShownIsSaid) {
  EXPECT_TRUE(holds(said_of({.scene = folder_ / "none.exr"}), "no such file"));
  EXPECT_TRUE(holds(said_of({.scene = folder_ / "none.#.exr"}), "none.#.exr: no file of that name is there"));
  const std::string own = write("own.exr", own_frame());
  EXPECT_EQ(said_of({.scene = own}), "");
  EXPECT_TRUE(holds(said_of({.scene = own, .overrides = {"camera.fov=3"}}), "has no keys to set"));
  EXPECT_TRUE(holds(said_of({.scene = test::source("data/scenes/cloud.toml"), .map = "map.toml"}), "is no frame"));
  std::filesystem::resize_file(own, std::filesystem::file_size(own) - 40);
  EXPECT_TRUE(holds(said_of({.scene = own}), "truncated or damaged"));
  std::ofstream(folder_ / "text.exr") << "no picture";
  EXPECT_NE(said_of({.scene = folder_ / "text.exr"}), "");
  Layers motion(kWidth, kHeight);
  motion.add("Z", 3);
  ViewedFrame depths(write("depths.exr", motion), "");
  EXPECT_TRUE(holds(depths.notes()[0], "no picture in it")) << "what is no light can be shown all the same";
  EXPECT_EQ(titles(depths), (std::vector<std::string>{"Z"}));
}

TEST_F(FrameView, ASequenceIsAnsweredFrameByFrameAndFilesThatChangeAreReadAgain) {
  for (int i = 1; i < 3; ++i) {
    Layers frame = own_frame();
    add_colour(frame, clean_light_layer("sky"), static_cast<float>(i));
    write(fmt::format("f.{}.exr", i), frame);
  }
  test::Audience audience;
  FrameViewer viewer({.scene = folder_ / "f.#.exr", .frames = {1, 2}}, {}, audience);
  ViewLook look;
  look.size = {kWidth, kHeight};
  look.layers = {"picture"};
  look.needs_scene = true;
  look.mix = {{"key", dvec3(0)}};
  for (int i = 1; i < 3; ++i) {
    look.id = static_cast<uint64_t>(i);
    look.frame = i;
    viewer.look(look);
    const auto shown = audience.first([&](const ViewPicture& p) { return p.id == look.id; });
    expect_scale(shown, dvec3(i));
    EXPECT_EQ(shown->frame, i);
  }
  EXPECT_TRUE(audience.scenes[0].of_frames);
  EXPECT_EQ(audience.scenes[0].frames, (std::vector<int>{1, 2}));
  EXPECT_TRUE(viewer.command(look).ends_with("f.2.exr --gain key=0 -o f.2_mix.exr")) << viewer.command(look);
  EXPECT_EQ(viewer.frame(look)->at("R")(3, 2), light(0, 3, 2, 2));
  std::ofstream(folder_ / "mix.toml") << viewer.scene_text(look);
  EXPECT_EQ(read_mix(folder_ / "mix.toml"), look.mix);
  look.mix = {{"moon", dvec3(0)}};
  EXPECT_THROW(viewer.scene_text(look), InputError);
  EXPECT_THROW(viewer.frame(look), InputError);
  // Written anew with another light: noticed between two checks.
  const auto before = audience.pictures.size();
  Layers frame = own_frame();
  add_colour(frame, clean_light_layer("sky"), 1.5f);
  write("f.2.exr", frame);
  std::filesystem::last_write_time(folder_ / "f.2.exr",
                                   std::filesystem::last_write_time(folder_ / "f.2.exr") + std::chrono::seconds(5));
  viewer.check_files();
  viewer.check_files();
  ASSERT_TRUE(audience.wait([&](const test::Audience& a) { return a.pictures.size() > before; }));
  expect_scale(audience.pictures.back(), dvec3(1.5));
  // Moved away and back as it was.
  std::filesystem::rename(folder_ / "f.2.exr", folder_ / "away.exr");
  viewer.check_files();
  viewer.check_files();
  ASSERT_TRUE(audience.wait([&](const test::Audience& a) { return !a.wrong.empty(); }));
  EXPECT_TRUE(audience.wrong[0].lasting);
  const auto while_away = audience.pictures.size();
  std::filesystem::rename(folder_ / "away.exr", folder_ / "f.2.exr");
  viewer.check_files();
  viewer.check_files();
  ASSERT_TRUE(audience.wait([&](const test::Audience& a) { return a.pictures.size() > while_away; }));
}

TEST_F(FrameView, AMixInAFileIsRefusedWhereItIsNone) {
  const std::filesystem::path path = folder_ / "mix.toml";
  for (const std::string text : {"", "[mix]\nkey = -1\n", "[mix]\nkey = [1, 2]\n", "mix = 3\n", "[mixes]\nkey = 1\n",
                                 "[mix]\nkey = \"bright\"\n", "[mix]\nkey = nan\n"}) {
    std::ofstream(path, std::ios::trunc) << text;
    EXPECT_THROW(read_mix(path), InputError) << text;
  }
  const LightMix mix = {{"key", dvec3(2)}, {"a b", dvec3(0, 0.1, 3)}};
  std::ofstream(path, std::ios::trunc) << toml_of_mix(mix);
  EXPECT_EQ(read_mix(path), mix);
  EXPECT_EQ(words_of_mix(mix), (std::vector<std::string>{"--gain", "key=2", "--colour", "a b=0,0.1,3"}));
}

}  // namespace
}  // namespace brume
