#pragma once
#include <ImfKeyCodeAttribute.h>
#include <ImfStringAttribute.h>

#include <bit>
#include <string>

#include "image/exr_copy.h"
#include "tests/support/foreign_frames.h"

namespace brume::test {

/// A view layer of Cycles whose passes add up to its picture.
inline Imf::Header cycles_header(Imf::PixelType type) {
  Imf::Header header =
      header_of({"My Layer.Combined:RGBA", "My Layer.VolumeDir:RGB", "My Layer.VolumeInd:RGB", "My Layer.Env:RGB",
                 "My Layer.Emit:RGB", "My Layer.Denoising Albedo:RGB", "My Layer.Shadow:RGB"},
                type);
  add_channels(header, channels_of("My Layer.CryptoObject00", "rgba"), Imf::FLOAT);
  add_channels(header, channels_of("My Layer.Vector", "XYZW"), Imf::FLOAT);
  add_channels(header, {"My Layer.Depth.Z"}, Imf::FLOAT);
  add_channels(header, {"My Layer.IndexOB.X"}, Imf::UINT);
  header.insert("cycles.My Layer.samples", Imf::StringAttribute("8"));
  header.insert("key", Imf::KeyCodeAttribute(Imf::KeyCode(1, 2, 3, 4, 5)));
  return header;
}

inline double cycles_value(const std::string& channel, int x, int y) {
  const char c = channel.back();
  if (holds(channel, ".Emit.")) return 0;
  if (!holds(channel, ".Combined.") || c == 'A') return noisy(channel, x, y);
  double sum = 0;
  for (const char* pass : {"VolumeDir", "VolumeInd", "Env"})
    sum += noisy(std::string("My Layer.") + pass + "." + c, x, y);
  return sum;
}

// The sum of the passes as they are stored, in the order that the header states, is the picture to the last bit.
inline void expect_sum(const std::string& path, bool half) {
  const Layers frame = read_exr(path);
  for (const char c : {'R', 'G', 'B'}) {
    const auto pass = [&](const char* name) -> const Plane& {
      return frame.at(std::string("My Layer.") + name + "." + c);
    };
    Plane sum(frame.width(), frame.height());
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        sum(x, y) = ((pass("VolumeDir")(x, y) + pass("VolumeInd")(x, y)) + pass("Env")(x, y)) + pass("Emit")(x, y);
    if (half) round_to_half(sum);
    size_t differing = 0;
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        differing += std::bit_cast<uint32_t>(sum(x, y)) != std::bit_cast<uint32_t>(pass("Combined")(x, y));
    EXPECT_EQ(differing, 0u) << c;
  }
}

}  // namespace brume::test
