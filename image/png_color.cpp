#include "image/png_color.h"

#include <cmath>
#include <cstdint>
#include <fstream>

#include "base/text.h"

namespace brume {
namespace {

uint32_t big_endian(const std::string& bytes, size_t at) {
  uint32_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes[at + i]);
  return value;
}

}  // namespace

PngColor read_png_color(const std::filesystem::path& path) {
  constexpr uint32_t kLongest = 1 << 24;  // bytes of a chunk that is read here
  std::ifstream file(path, std::ios::binary);
  std::string begin(8, '\0');
  file.read(begin.data(), 8);
  PngColor color;
  if (!file || begin != "\x89PNG\r\n\x1a\n") return color;
  bool srgb = false;
  while (file.read(begin.data(), 8)) {
    const uint32_t size = big_endian(begin, 0);
    const std::string type = begin.substr(4);
    if (type == "IDAT" || type == "IEND" || size > kLongest) break;
    std::string data(size, '\0');
    file.read(data.data(), static_cast<std::streamsize>(size));
    file.ignore(4);  // checksum
    if (!file) break;
    if (type == "sRGB") srgb = true;
    if (type == "cICP" && data != std::string("\1\15\0\1", 4))
      color.profile = "cICP";  // Rec. 709 primaries, sRGB curve
    if (type == "iCCP" && lower(data.substr(0, data.find('\0'))).find("srgb") == std::string::npos)
      color.profile = data.substr(0, data.find('\0'));
    if (type == "iCCP") srgb = srgb || color.profile.empty();
    constexpr double kUnit = 1e-5;
    if (type == "gAMA" && size == 4) color.gamma = big_endian(data, 0) * kUnit;
    if (type == "cHRM" && size == 32) {
      color.chromaticities.emplace();
      for (size_t i = 0; i < 8; ++i)  // white comes first there
        (*color.chromaticities)[(i + 6) % 8] = static_cast<float>(big_endian(data, 4 * i) * kUnit);
    }
  }
  if (srgb || !color.profile.empty()) {
    color.gamma.reset();
    color.chromaticities.reset();
  }
  // 1 / 2.2 stands for sRGB's curve in files of programs that mean that.
  if (color.gamma && (std::abs(*color.gamma - 1 / 2.2) < 0.01 || !(*color.gamma > 0.01))) color.gamma.reset();
  return color;
}

}  // namespace brume
