#include "image/exr_zip.h"

#include <libdeflate.h>

#include <bit>
#include <cstring>
#include <memory>
#include <new>

namespace brume {
namespace {

static_assert(std::endian::native == std::endian::little, "OpenEXR files are little-endian");

constexpr int kLevel = 4;  // more gains 1 % of noisy frames' bytes

using Compressor = std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)>;

// Calls row(bytes) for each row of the lines, in the file's order.
template <class Row>
void for_each_row(std::span<const ExrChannel> channels, int y, int lines, const Row& row) {
  for (int line = y; line < y + lines; ++line)
    for (const ExrChannel& c : channels)
      row(static_cast<const uint8_t*>(c.values) + static_cast<size_t>(line) * c.stride * sizeof(uint32_t));
}

}  // namespace

std::vector<uint8_t> zip_exr_lines(std::span<const ExrChannel> channels, int width, int y, int lines) {
  const size_t row_bytes = static_cast<size_t>(width) * sizeof(uint32_t), size = channels.size() * lines * row_bytes;
  if (size == 0) return {};
  static thread_local std::vector<uint8_t> sorted, differences;
  sorted.resize(size), differences.resize(size);
  uint8_t *even = sorted.data(), *odd = even + size / 2;
  for_each_row(channels, y, lines, [&](const uint8_t* row) {
    for (int x = 0; x < width; ++x) {
      uint32_t value;
      std::memcpy(&value, row + sizeof(value) * static_cast<size_t>(x), sizeof(value));
      const auto pair = [](uint32_t v) { return static_cast<uint16_t>((v & 0xff) | (v >> 8 & 0xff00)); };
      const uint16_t at_even = pair(value), at_odd = pair(value >> 8);
      std::memcpy(even + sizeof(at_even) * static_cast<size_t>(x), &at_even, sizeof(at_even));
      std::memcpy(odd + sizeof(at_odd) * static_cast<size_t>(x), &at_odd, sizeof(at_odd));
    }
    even += row_bytes / 2, odd += row_bytes / 2;
  });
  differences[0] = sorted[0];
  for (size_t i = 1; i < size; ++i) differences[i] = static_cast<uint8_t>(sorted[i] - sorted[i - 1] + 128);

  static thread_local const Compressor compressor(libdeflate_alloc_compressor(kLevel), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  static thread_local std::vector<uint8_t> packed;
  packed.resize(size);
  size_t packed_size = libdeflate_zlib_compress(compressor.get(), differences.data(), size, packed.data(), size - 1);
  if (packed_size == 0)
    for_each_row(channels, y, lines, [&](const uint8_t* row) {
      std::memcpy(packed.data() + packed_size, row, row_bytes);
      packed_size += row_bytes;
    });
  return {packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(packed_size)};
}

}  // namespace brume
