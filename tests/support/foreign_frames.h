#pragma once
#include <ImfStandardAttributes.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "image/exr_io.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"
#include "tests/support/frames.h"
#include "tests/support/holds.h"

// Frames as other renderers write them, through the program.

namespace brume::test {

inline constexpr int kWidth = 30, kHeight = 22;

/// A smooth picture of its own for each channel, with the noise of a renderer.
inline double truth(const std::string& channel, int x, int y) {
  return 1 + 0.2 * std::sin(0.1 * x + 0.07 * y + static_cast<double>(std::hash<std::string>()(channel) % 7));
}
inline double noisy(const std::string& channel, int x, int y) {
  return std::max(0.0, truth(channel, x, y) + 0.1 * normal(x, y, std::hash<std::string>()(channel)));
}

/// Channels in groups of one layer and type: "V.Combined:RGBA".
inline Imf::Header header_of(const std::vector<std::string>& layers, Imf::PixelType type) {
  Imf::Header header = exr_header(kWidth, kHeight);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const std::string& text : layers) {
    const size_t colon = text.rfind(':');
    add_channels(header, channels_of(text.substr(0, colon), text.substr(colon + 1)), type);
  }
  return header;
}

/// A frame `in` that is cleaned to `out`.
class Frames : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void write(const std::vector<ExrPart>& parts) { write_exr_file(in, parts); }
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
    EXPECT_FALSE(has_half_written(folder_.path()));
    return r.err;
  }
  /// Everything is as it was but these layers of colours, and what says so in the header.
  void expect_kept_but(const std::vector<std::string>& layers, const std::string& letters = "RGB") {
    EXPECT_EQ(exr_channels(in), exr_channels(out));
    for (const std::string& name : differing(exr_attributes(in), exr_attributes(out)))
      EXPECT_TRUE(holds(name, "/brume.") || name == "/fileChecksum") << name;
    std::set<std::string> changed;
    for (const std::string& layer : layers)
      for (const std::string& name : channels_of(layer, letters)) changed.insert("/" + name + "/0,0");
    EXPECT_EQ(differing(exr_bits(in), exr_bits(out)), changed);
  }

  TemporaryFolder folder_;
  std::string in = path("shot.exr"), out = path("clean.exr");
};

inline double error(const Layers& frame, const std::string& channel) {
  double sum = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x)
      sum += std::pow(static_cast<double>(frame.at(channel)(x, y)) - truth(channel, x, y), 2);
  return std::sqrt(sum / (frame.width() * frame.height()));
}

}  // namespace brume::test
