#include "image/usable_colors.h"

#include <ImfEnvmap.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "base/error.h"
#include "base/math.h"
#include "image/cube_map.h"
#include "image/exr_io.h"
#include "image/picture_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity(), kNan = std::numeric_limits<float>::quiet_NaN();
const Chromaticities kAcesCg = {0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f};

Layers grey(int width, int height, float value) {
  Layers picture(width, height);
  for (Plane* plane : picture.add_rgb(layer::beauty)) plane->fill(value);
  return picture;
}

bool holds(const std::vector<std::string>& notes, const std::string& part) {
  return std::any_of(notes.begin(), notes.end(),
                     [&](const std::string& note) { return note.find(part) != std::string::npos; });
}

class Pictures : public ::testing::Test {
 protected:
  UsablePicture written(const Layers& picture) const {
    write_exr(folder_ / "a.exr", picture);
    return read_usable_picture(folder_ / "a.exr");
  }
  test::TemporaryFolder folder_;
};

TEST_F(Pictures, WithoutAnythingToRepairAreLeftAsTheyAre) {
  Layers picture = grey(4, 2, 0.25f);
  picture.header["chromaticities"] = kRec709;
  const UsablePicture read = written(picture);
  EXPECT_TRUE(read.notes.empty());
  EXPECT_EQ(read.layers.at("G")(3, 1), 0.25f);
}

TEST_F(Pictures, CountWhatIsNoLight) {
  Layers picture = grey(4, 2, 0.5f);
  (*picture.find("R"))(0, 0) = kNan;
  (*picture.find("G"))(1, 0) = -0.0001f;
  (*picture.find("B"))(2, 0) = -kInfinity;
  (*picture.find("B"))(3, 1) = kInfinity;
  (*picture.find("R"))(3, 1) = 7;
  const UsablePicture read = written(picture);
  EXPECT_EQ(read.layers.at("R")(0, 0), 0.0f);
  EXPECT_EQ(read.layers.at("G")(0, 0), 0.5f) << "the other channels of the pixel stay";
  EXPECT_EQ(read.layers.at("G")(1, 0), 0.0f);
  EXPECT_EQ(read.layers.at("B")(2, 0), 0.0f);
  EXPECT_EQ(read.layers.at("B")(3, 1), 7.0f);
  ASSERT_EQ(read.notes.size(), 2u);
  EXPECT_TRUE(holds(read.notes, "a.exr: 1 NaN value and 2 negative values became 0")) << read.notes[0];
  EXPECT_TRUE(holds(read.notes, "1 infinite value became the largest finite one, 7")) << read.notes[1];
  EXPECT_TRUE(holds(written(grey(2, 1, kNan)).notes, "6 NaN values became 0"));
  EXPECT_EQ(written(grey(2, 1, kInfinity)).layers.at("R")(0, 0), 0.0f) << "where nothing is finite";
}

TEST_F(Pictures, OfOtherColourSpacesAreConvertedAndTold) {
  Layers picture = grey(3, 1, 0.5f);
  (*picture.find("R"))(1, 0) = 1;                                 // ACEScg (1, 0.5, 0.5)
  for (const char* c : {"R", "B"}) (*picture.find(c))(2, 0) = 0;  // a green outside of Rec. 709
  picture.header["chromaticities"] = kAcesCg;
  const UsablePicture read = written(picture);
  EXPECT_NEAR(read.layers.at("R")(0, 0), 0.5, 1e-5) << "white stays white";
  EXPECT_NEAR(read.layers.at("B")(0, 0), 0.5, 1e-5);
  EXPECT_NEAR(read.layers.at("R")(1, 0), 0.5 + 0.5 * 1.70505, 1e-3);
  EXPECT_NEAR(read.layers.at("G")(1, 0), 0.5 - 0.5 * 0.13026, 1e-3);
  EXPECT_NEAR(read.layers.at("G")(2, 0), 0.5 * 1.14080, 1e-3);
  EXPECT_EQ(read.layers.at("R")(2, 0), 0.0f);
  ASSERT_EQ(read.notes.size(), 1u);
  EXPECT_TRUE(holds(read.notes, "a.exr: its colours are ACEScg (AP1): converted to linear Rec. 709")) << read.notes[0];
  EXPECT_TRUE(holds(read.notes, "2 negative values outside of it became 0")) << read.notes[0];
  EXPECT_FALSE(read.layers.chromaticities());
}

TEST_F(Pictures, OfAcesContainersAreAp0AndDegenerateSpacesAreRefused) {
  Layers picture = grey(1, 1, 0.5f);
  picture.header["acesImageContainerFlag"] = 1;
  EXPECT_TRUE(holds(written(picture).notes, "ACES 2065-1 (AP0)"));
  picture.header.erase("acesImageContainerFlag");
  for (const char* name : {"lin_ap1_scene", "ACEScg"}) {
    picture.header["oiio:ColorSpace"] = std::string(name);
    EXPECT_TRUE(holds(written(picture).notes, "ACEScg (AP1)")) << name;
  }
  for (const char* name : {"lin_rec709_scene", "Linear", "scene_linear"}) {
    picture.header["oiio:ColorSpace"] = std::string(name);
    EXPECT_TRUE(written(picture).notes.empty()) << name;
  }
  picture.header["chromaticities"] = Chromaticities{};
  try {
    written(picture);
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("a.exr: chromaticities 0 0, 0 0"), std::string::npos) << error.what();
  }
}

TEST_F(Pictures, KeepTheirColourSpaceThroughAFrameInMemory) {
  Layers picture = grey(2, 1, 0.5f);
  picture.header["chromaticities"] = kAcesCg;
  picture.header["envmap"] = std::string("cube");
  write_exr(folder_ / "a.exr", picture);
  const Layers read = read_exr(folder_ / "a.exr");
  EXPECT_EQ(read.chromaticities(), kAcesCg);
  EXPECT_TRUE(is_cube_map(read));
  EXPECT_EQ(read_exr_info(folder_ / "a.exr").header.at("chromaticities"), Attribute(kAcesCg));
}

TEST_F(Pictures, OfOneChannelYAreGrey) {
  Layers picture(2, 1);
  picture.add("Y", 0.25f);
  const UsablePicture read = written(picture);
  for (const char* c : {"R", "G", "B"}) EXPECT_EQ(read.layers.at(c)(1, 0), 0.25f);
}

// The layout is OpenEXR's own: what a texel holds is found where its functions put that texel.
TEST(CubeMap, IsLaidOutAsOpenExrSays) {
  constexpr int kSize = 33;
  Layers cube(kSize, 6 * kSize);
  const auto rgb = cube.add_rgb(layer::beauty);
  const Imath::Box2i window(Imath::V2i(0, 0), Imath::V2i(kSize - 1, 6 * kSize - 1));
  // Each texel holds its direction, as a colour.
  for (int face = 0; face < 6; ++face)
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x) {
        const Imath::V2f in_face(static_cast<float>(x), static_cast<float>(y));
        const Imath::V3f d = Imf::CubeMap::direction(Imf::CubeMapFace(face), window, in_face).normalized();
        const Imath::V2f at = Imf::CubeMap::pixelPosition(Imf::CubeMapFace(face), window, in_face);
        for (int c = 0; c < 3; ++c)
          (*rgb[static_cast<size_t>(c)])(static_cast<int>(at.x + 0.5f), static_cast<int>(at.y + 0.5f)) = 1 + d[c];
      }
  const Layers picture = lat_long_of_cube(cube, "a.exr");
  ASSERT_EQ(picture.width(), 4 * kSize);
  ASSERT_EQ(picture.height(), 2 * kSize);
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x) {
      // Pixels of lat-long pictures are areas here: +pi at the left edge, +pi / 2 at the top.
      const double longitude = kPi * (1 - 2 * (x + 0.5) / picture.width()),
                   latitude = kPi * (0.5 - (y + 0.5) / picture.height());
      const dvec3 d(std::sin(longitude) * std::cos(latitude), std::sin(latitude),
                    std::cos(longitude) * std::cos(latitude));
      const char* const channels[] = {"R", "G", "B"};
      for (int c = 0; c < 3; ++c)
        ASSERT_NEAR(picture.at(channels[c])(x, y), 1 + d[c], 0.01) << x << ' ' << y << ' ' << c;
    }
  Layers wrong = grey(4, 8, 1);
  EXPECT_THROW(lat_long_of_cube(wrong, "b.exr"), InputError);
}

TEST(CubeMap, OfOneTexelForEachFaceIsRead) {
  Layers cube(1, 6);
  for (Plane* plane : cube.add_rgb(layer::beauty))
    for (int y = 0; y < 6; ++y) (*plane)(0, y) = static_cast<float>(y);
  const Layers picture = lat_long_of_cube(cube, "a.exr");
  EXPECT_GT(picture.at("R")(0, 0), 1.9f) << "the upper row is mostly +Y";
}

std::string png_with(const std::string& chunk, const std::filesystem::path& path) {
  Picture picture(2, 1, {188, 188, 188});
  write_png(path, picture);
  std::string bytes = test::read_file(path);
  constexpr size_t kAfterHeader = 8 + 25;
  bytes.insert(kAfterHeader, chunk);
  test::write_file(path, bytes);
  return path.string();
}

std::string chunk_of(const std::string& type, const std::string& data) {
  std::string bytes = {0, 0, 0, static_cast<char>(data.size())};
  return bytes + type + data + std::string(4, '\0');  // its checksum is not looked at
}

std::string number(double value) {
  const auto whole = static_cast<uint32_t>(value * 1e5 + 0.5);
  return {static_cast<char>(whole >> 24), static_cast<char>(whole >> 16), static_cast<char>(whole >> 8),
          static_cast<char>(whole)};
}

TEST_F(Pictures, OfPngsAreDecodedAsTheySay) {
  const auto read = [&](const std::string& chunks) { return read_usable_picture(png_with(chunks, folder_ / "a.png")); };
  const UsablePicture plain = read("");
  EXPECT_NEAR(plain.layers.at("R")(0, 0), 0.503, 1e-3);
  EXPECT_TRUE(plain.notes.empty());
  EXPECT_TRUE(read(chunk_of("gAMA", number(1 / 2.2))).notes.empty()) << "what stands for sRGB";
  const UsablePicture linear = read(chunk_of("gAMA", number(1)));
  EXPECT_NEAR(linear.layers.at("R")(0, 0), 188 / 255.0, 1e-4);
  EXPECT_TRUE(holds(linear.notes, "a gamma of 1"));
  const std::string p3 = number(0.3127) + number(0.329) + number(0.68) + number(0.32) + number(0.265) + number(0.69) +
                         number(0.15) + number(0.06);
  EXPECT_TRUE(holds(read(chunk_of("cHRM", p3)).notes, "its colours are P3 (D65)"));
  EXPECT_TRUE(read(chunk_of("sRGB", std::string(1, '\0')) + chunk_of("cHRM", p3)).notes.empty());
  EXPECT_TRUE(holds(read(chunk_of("iCCP", std::string("Display P3\0\0xx", 14))).notes, "colour profile (Display P3)"));
  EXPECT_TRUE(read(chunk_of("iCCP", std::string("sRGB IEC61966-2.1\0\0xx", 21))).notes.empty());
}

}  // namespace
}  // namespace brume
