// Deep pixels: how samples are cut, joined and composited, and what files of them may hold.

#include "image/deep_picture.h"

#include <ImfChannelList.h>
#include <ImfDeepFrameBuffer.h>
#include <ImfDeepTiledOutputFile.h>
#include <ImfHeader.h>
#include <ImfPartType.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "image/exr_deep.h"
#include "tests/support/error_of.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using Type = DeepPicture::Channel::Type;

constexpr float kEnd = std::numeric_limits<float>::infinity();

/// Samples of Z, ZBack, A and one colour.
DeepPixel pixel_of(const std::vector<std::array<float, 4>>& samples) {
  DeepPixel pixel{4, {}};
  for (const auto& s : samples) pixel.values.insert(pixel.values.end(), s.begin(), s.end());
  return pixel;
}

/// One pixel of Z, ZBack, A, R, G, B, all colours alike.
DeepPicture picture_of(const std::vector<std::array<float, 4>>& samples) {
  const uint32_t counts[] = {static_cast<uint32_t>(samples.size())};
  DeepPicture picture({ivec2(0), ivec2(1)}, {ivec2(0), ivec2(1)}, counts);
  const char* const names[] = {"Z", "ZBack", "A", "R", "G", "B"};
  for (size_t c = 0; c < 6; ++c) {
    std::vector<float>& values = picture.add(names[c]).values;
    for (size_t i = 0; i < samples.size(); ++i) values[i] = samples[i][std::min<size_t>(c, 3)];
  }
  return picture;
}

TEST(DeepPicture, AVolumeInFrontOfADepthHasTheRestOfItsTransmittanceBehind) {
  for (const double alpha : {1e-9, 0.1, 0.5, 0.99})
    for (const double share : {0.0, 0.3, 1.0}) {
      const double front = front_share(alpha, share).alpha * alpha,
                   behind = front_share(alpha, 1 - share).alpha * alpha;
      EXPECT_NEAR((1 - front) * (1 - behind), 1 - alpha, 1e-12) << alpha << " " << share;
    }
  EXPECT_EQ(front_share(1, 0.5).alpha, 1);
  EXPECT_EQ(front_share(0, 0.25).colour, 0.25);  // light of what covers nothing, evenly spread
}

TEST(DeepPicture, OverlappingVolumesBecomeTheirMixture) {
  // One at 0 .. 4 of optical depth 2 that shines 1 per unit of it, one at 1 .. 3 of 1 that shines 5.
  const auto emitted = [](double depth, double shine) { return static_cast<float>(shine * -std::expm1(-depth)); };
  DeepPixel pixel = pixel_of({{1, 3, emitted(1, 1), emitted(1, 5)}, {0, 4, emitted(2, 1), emitted(2, 1)}});
  make_tidy(pixel);
  ASSERT_EQ(pixel.size(), 3u);
  for (const float before : {0.5f, 1.f, 2.2f, 3.f, 3.7f, kEnd}) {
    double light = 0, depth = 0;
    constexpr double kStep = 1e-4;
    for (double z = kStep / 2; z < std::min(4.0, static_cast<double>(before)); z += kStep) {
      const double first = 0.5, second = z > 1 && z < 3 ? 0.5 : 0;
      light += std::exp(-depth) * (first * 1 + second * 5) * kStep;
      depth += (first + second) * kStep;
    }
    const std::vector<double> sums = composited(pixel, before);
    EXPECT_NEAR(sums[0], -std::expm1(-depth), 2e-4) << before;
    EXPECT_NEAR(sums[1], light, 2e-3) << before;
  }
}

TEST(DeepPicture, PointsAtOneDepthAndInsideVolumesAreInOrder) {
  DeepPixel pixel = pixel_of({{2, 2, 0.5f, 0.5f}, {1, 3, 0.75f, 0}, {2, 2, 0.5f, 0}, {9, 9, 1, 1}});
  make_tidy(pixel);
  ASSERT_EQ(pixel.size(), 4u);
  EXPECT_FLOAT_EQ(pixel.at(1)[2], 0.75f);
  EXPECT_FLOAT_EQ(pixel.at(0)[2], 0.5f);
  const std::vector<double> all = composited(pixel, kEnd);
  EXPECT_FLOAT_EQ(static_cast<float>(all[0]), 1);
}

TEST(DeepPicture, RecolouredItFlattensToTheOtherPicture) {
  DeepPicture picture = picture_of({{1, 2, 0.5f, 0.25f}, {3, 3, 1, 0.1f}});
  picture.channels.at("B").values = {0, 0};
  const Layers flat = flattened(picture);
  Layers other(1, 1);
  for (const char* name : {"R", "G", "B"}) other.add(name)(0, 0) = 0.7f;
  recolour(picture, flat, other);
  const Layers again = flattened(picture);
  for (const char* name : {"R", "G", "B"}) EXPECT_NEAR(again.at(name)(0, 0), 0.7f, 1e-6) << name;
  EXPECT_EQ(again.at("A")(0, 0), flat.at("A")(0, 0));
}

TEST(DeepPicture, EachColourIsCompositedByItsOwnAlpha) {
  DeepPicture picture = picture_of({{1, 1, 0.5f, 0.5f}, {2, 2, 1, 1}});
  picture.channels.erase("A");
  picture.add("AR").values = {0.25f, 1};
  picture.add("AG").values = {0.5f, 1};
  picture.add("AB").values = {1, 1};
  const Layers flat = flattened(picture, 1.5f);
  EXPECT_NEAR(flat.at("A")(0, 0), (0.25f + 0.5f + 1) / 3, 1e-6);
  const Layers all = flattened(picture);
  EXPECT_FLOAT_EQ(all.at("R")(0, 0), 0.5f + 0.75f);
  EXPECT_FLOAT_EQ(all.at("B")(0, 0), 0.5f);
  picture.channels.erase("AG");
  EXPECT_NE(test::error_of([&] { flattened(picture); }).find("whose channel G has no alpha"), std::string::npos);
}

class DeepFile : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string refusal(const DeepPicture& picture) {
    write_deep_exr(path("odd.exr"), picture);
    return test::error_of([&] { read_deep_exr(path("odd.exr")); });
  }
  test::TemporaryFolder folder_;
};

TEST_F(DeepFile, IsReadAsItWasWritten) {
  constexpr int kWidth = 5, kHeight = 67;
  std::vector<uint32_t> counts;
  for (uint32_t i = 0; i < kWidth * kHeight; ++i) counts.push_back(i % 7);
  DeepPicture picture({{-2, 3}, {kWidth - 2, kHeight + 3}}, {{0, 0}, {9, 99}}, counts);
  for (const auto& [name, type] : {std::pair("Z", Type::kFloat), {"A", Type::kHalf}, {"R", Type::kHalf}}) {
    std::vector<float>& values = picture.add(name, type).values;
    for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i % 32) / 32;
  }
  picture.header["scene"] = std::string("made up");
  write_deep_exr(path("deep.exr"), picture);
  EXPECT_TRUE(has_deep_part(path("deep.exr")));
  const DeepPicture read = read_deep_exr(path("deep.exr"));
  EXPECT_EQ(read.begin, picture.begin);
  EXPECT_EQ(read.data, picture.data);
  EXPECT_EQ(read.display, picture.display);
  for (const auto& [name, channel] : picture.channels) {
    EXPECT_EQ(read.channels.at(name).values, channel.values) << name;
    EXPECT_EQ(read.channels.at(name).type, channel.type) << name;
  }
  EXPECT_EQ(std::get<std::string>(read.header.at("scene")), "made up");
}

TEST_F(DeepFile, OfTilesIsReadToo) {
  constexpr int kSize = 10;
  Imf::Header header(kSize, kSize);
  header.setType(Imf::DEEPTILE);
  header.setTileDescription(Imf::TileDescription(4, 4));
  header.compression() = Imf::ZIPS_COMPRESSION;
  test::add_channels(header, {"A", "Z"}, Imf::FLOAT);
  {
    Imf::DeepTiledOutputFile file(path("tiles.exr").c_str(), header);
    std::vector<unsigned> counts(kSize * kSize, 1);
    std::vector<float> values(kSize * kSize);
    std::vector<float*> samples(kSize * kSize);
    for (size_t i = 0; i < values.size(); ++i) {
      values[i] = static_cast<float>(i) / kSize / kSize;
      samples[i] = &values[i];
    }
    Imf::DeepFrameBuffer buffer;
    buffer.insertSampleCountSlice(Imf::Slice(Imf::UINT, reinterpret_cast<char*>(counts.data()), 4, 4 * kSize));
    for (const char* name : {"A", "Z"})
      buffer.insert(name, Imf::DeepSlice(Imf::FLOAT, reinterpret_cast<char*>(samples.data()), sizeof(float*),
                                         kSize * sizeof(float*), sizeof(float)));
    file.setFrameBuffer(buffer);
    file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
  }
  const Layers flat = flattened(read_deep_exr(path("tiles.exr")));
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      EXPECT_FLOAT_EQ(flat.at("A")(x, y), static_cast<float>(y * kSize + x) / kSize / kSize);
}

TEST_F(DeepFile, WithoutSenseIsRefused) {
  const auto expect = [&](const DeepPicture& picture, const std::string& words) {
    EXPECT_NE(refusal(picture).find(words), std::string::npos) << refusal(picture);
  };
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  expect(picture_of({{kNan, 2, 0.5f, 1}}), "the deep pixel 0,0 has a sample whose Z is nan; expected a number");
  expect(picture_of({{1, 2, 0.5f, 1}, {3, 2, 0.5f, 1}}), "has a sample from Z = 3 to ZBack = 2");
  expect(picture_of({{1, 2, 1.5f, 1}}), "whose A is 1.5; expected 0 .. 1");
  expect(picture_of({{1, 2, 0.5f, kEnd}}), "is inf; expected a number");
  DeepPicture nowhere = picture_of({{1, 2, 0.5f, 1}});
  nowhere.channels.erase("Z");
  EXPECT_NE(test::error_of([&] { flattened(nowhere); }).find("without a channel Z"), std::string::npos);
  EXPECT_TRUE(refusal(picture_of({{3, 3, 0.5f, 1}, {1, 5, 0.5f, 1}})).empty());  // of no order is right
}

TEST_F(DeepFile, CutAnywhereIsRefused) {
  std::vector<uint32_t> counts(64 * 8, 3);
  DeepPicture picture({{0, 0}, {64, 8}}, {{0, 0}, {64, 8}}, counts);
  for (const char* name : {"Z", "A"}) {
    std::vector<float>& values = picture.add(name).values;
    for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i * 37 % 101) / 101;
  }
  write_deep_exr(path("whole.exr"), picture);
  const std::string bytes = test::read_file(path("whole.exr"));
  for (size_t size = 1; size < bytes.size(); size += 1 + bytes.size() / 97) {
    std::ofstream(path("cut.exr"), std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(size));
    EXPECT_FALSE(test::error_of([&] { read_deep_exr(path("cut.exr")); }).empty()) << size;
  }
  // Any byte changed: an error or other values, never a crash or all of the memory.
  for (size_t at = 300; at < bytes.size(); at += 1 + bytes.size() / 211) {
    std::string odd = bytes;
    odd[at] = static_cast<char>(odd[at] ^ 0x5a);
    std::ofstream(path("odd.exr"), std::ios::binary).write(odd.data(), static_cast<std::streamsize>(odd.size()));
    test::error_of([&] { read_deep_exr(path("odd.exr")); });
  }
}

}  // namespace
}  // namespace brume
