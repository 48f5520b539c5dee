#include "image/packed_half.h"

#include <Imath/half.h>
#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <memory>
#include <new>

namespace brume {
namespace {

constexpr int kLevel = 9;
constexpr int kMiddle = 32768;

uint16_t bits_of(float value) {
  const float largest = HALF_MAX;
  return half(value > largest ? largest : value < -largest ? -largest : value).bits();
}

/// An integer that orders halves by their values.
int ordered_half(float value) {
  const uint16_t bits = bits_of(value);
  return bits & 0x8000 ? ~bits & 0xFFFF : bits | 0x8000;
}

int predict(int left, int up, int corner) {
  const auto [low, high] = std::minmax(left, up);
  return corner >= high ? low : corner <= low ? high : left + up - corner;
}

}  // namespace

std::vector<uint16_t> half_bits(const Plane& plane) {
  std::vector<uint16_t> bits;
  bits.reserve(static_cast<size_t>(plane.width()) * plane.height());
  for (int y = 0; y < plane.height(); ++y)
    for (const float value : plane.pixels(y)) bits.push_back(bits_of(value));
  return bits;
}

std::vector<uint8_t> pack_half(const RgbPlanes& rgb) {
  const int width = rgb[0]->width();
  const int height = rgb[0]->height();
  const size_t size = static_cast<size_t>(width) * height;
  std::array<std::vector<int>, 3> planes;
  for (std::vector<int>& plane : planes) plane.reserve(size);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const int green = ordered_half((*rgb[1])(x, y));
      planes[0].push_back(green);
      planes[1].push_back((ordered_half((*rgb[0])(x, y)) - green + kMiddle) & 0xFFFF);
      planes[2].push_back((ordered_half((*rgb[2])(x, y)) - green + kMiddle) & 0xFFFF);
    }

  std::vector<uint8_t> bytes(6 * size);
  size_t at = 0;
  for (const std::vector<int>& plane : planes)
    for (size_t i = 0; i < size; ++i, ++at) {
      const bool first_column = i % width == 0;
      const bool first_row = i < static_cast<size_t>(width);
      const int up_or_start = first_row ? kMiddle : plane[i - width];
      const int left = first_column ? up_or_start : plane[i - 1];
      const int up = first_row ? left : plane[i - width];
      const int corner = first_column || first_row ? up : plane[i - width - 1];
      const auto residual = static_cast<int16_t>(plane[i] - predict(left, up, corner));
      const int folded = residual < 0 ? -2 * residual - 1 : 2 * residual;
      bytes[at] = static_cast<uint8_t>(folded >> 8);
      bytes[3 * size + at] = static_cast<uint8_t>(folded);
    }

  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(kLevel), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  std::vector<uint8_t> packed(libdeflate_zlib_compress_bound(compressor.get(), bytes.size()));
  packed.resize(libdeflate_zlib_compress(compressor.get(), bytes.data(), bytes.size(), packed.data(), packed.size()));
  return packed;
}

}  // namespace brume
