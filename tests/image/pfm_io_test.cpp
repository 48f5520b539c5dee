#include "image/pfm_io.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "base/error.h"
#include "tests/support/files.h"

namespace brume {
namespace {

std::string bytes_of(std::initializer_list<float> values) {
  std::string bytes(values.size() * sizeof(float), '\0');
  std::memcpy(bytes.data(), std::data(values), bytes.size());
  return bytes;
}

std::string swapped(std::string bytes) {
  for (size_t i = 0; i + 3 < bytes.size(); i += 4)
    std::reverse(bytes.begin() + static_cast<long>(i), bytes.begin() + static_cast<long>(i) + 4);
  return bytes;
}

TEST(Pfm, RowsGoFromTheBottomUpInLittleEndianFloats) {
  const test::TemporaryFolder folder;
  Layers frame(2, 3);
  const auto rgb = frame.add_rgb(layer::beauty);
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 2; ++x)
      for (size_t c = 0; c < 3; ++c) (*rgb[c])(x, y) = static_cast<float>(100 * y + 10 * x) + static_cast<float>(c);
  const RgbPlanes planes = frame.rgb(layer::beauty);
  write_pfm(folder / "a.pfm", planes);
  EXPECT_EQ(test::read_file(folder / "a.pfm"), "PF\n2 3\n-1.0\n" + bytes_of({200, 201, 202, 210, 211, 212,  //
                                                                             100, 101, 102, 110, 111, 112,  //
                                                                             0, 1, 2, 10, 11, 12}));
  const Plane* const one[] = {planes[1]};
  write_pfm(folder / "b.pfm", one);
  EXPECT_EQ(test::read_file(folder / "b.pfm"), "Pf\n2 3\n-1.0\n" + bytes_of({201, 211, 101, 111, 1, 11}));
  EXPECT_FALSE(test::has_half_written(folder.path()));
}

TEST(Pfm, IsReadAgainToTheBit) {
  const test::TemporaryFolder folder;
  Layers frame(3, 2);
  float value = -1e-40f;  // denormal
  for (Plane* plane : frame.add_rgb(layer::beauty))
    for (int y = 0; y < 2; ++y)
      for (int x = 0; x < 3; ++x) (*plane)(x, y) = value *= -7.3f;
  (*frame.add_rgb(layer::beauty)[2])(1, 1) = std::numeric_limits<float>::infinity();
  write_pfm(folder / "a.pfm", frame.rgb(layer::beauty));
  const Layers again = read_pfm(folder / "a.pfm");
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < 2; ++y)
      for (int x = 0; x < 3; ++x) EXPECT_EQ((*again.rgb(layer::beauty)[c])(x, y), (*frame.rgb(layer::beauty)[c])(x, y));
}

TEST(Pfm, BothByteOrdersScalesAndGreyAreRead) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "big.pfm", "Pf\r\n2 1\r\n2.0\n" + swapped(bytes_of({0.5f, -3})));
  const Layers big = read_pfm(folder / "big.pfm");
  EXPECT_EQ(big.names(), std::vector<std::string>{"Y"});
  EXPECT_EQ(big.at("Y")(0, 0), 1);
  EXPECT_EQ(big.at("Y")(1, 0), -6);
  test::write_file(folder / "spaces.pfm", "PF 1 1 -1.0 " + bytes_of({1, 2, 3}));
  EXPECT_EQ(read_pfm(folder / "spaces.pfm").at("B")(0, 0), 3);
}

TEST(Pfm, BrokenFilesAreNamed) {
  const test::TemporaryFolder folder;
  const auto error = [&](const std::string& bytes) -> std::string {
    test::write_file(folder / "broken.pfm", bytes);
    try {
      read_pfm(folder / "broken.pfm");
    } catch (const InputError& failure) {
      return failure.what();
    }
    return "";
  };
  const std::string pixels = bytes_of({1, 2, 3});
  for (const auto& [bytes, what] :
       {std::pair<std::string, std::string>{"", "no portable float map"},
        {"P6\n1 1\n255\n", "no portable float map"},
        {"PF\n", "expected width, height and a scale"},
        {"PF\nx 1\n-1\n" + pixels, "expected width, height and a scale"},
        {"PF\n1 1\n0\n" + pixels, "a scale that is not 0"},
        {"PF\n1 1\nnan\n" + pixels, "expected width, height and a scale"},
        {"PF\n0 1\n-1\n" + pixels, "is 0 x 1 pixels"},
        {"PF\n-1 1\n-1\n" + pixels, "is -1 x 1 pixels"},
        {"PF\n99999999999 1\n-1\n" + pixels, "expected width, height and a scale"},
        {"PF\n70000 1\n-1\n" + pixels, "expected 1 .. 65536 on a side"},
        {"PF\n65536 65536\n-1\n" + pixels, "truncated: 12 bytes of pixels, expected 51539607552"},
        {"PF\n1 1\n-1\n" + pixels.substr(0, 11), "truncated: 11 bytes of pixels, expected 12 for 1 x 1"}})
    EXPECT_NE(error(bytes).find(what), std::string::npos) << error(bytes) << " lacks: " << what;
  EXPECT_THROW(read_pfm(folder / "missing.pfm"), InputError);
  EXPECT_THROW(read_pfm(folder.path()), InputError);
}

}  // namespace
}  // namespace brume
