#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "image/exr_zip.cpp"
#include "image/exr_zip.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <libdeflate.h>

#include <bit>
#include <cstring>
#include <memory>
#include <new>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Bytes at even places, then those at odd ones.
void Sort(const uint8_t* bytes, size_t count, uint8_t* even, uint8_t* odd) {
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<uint8_t> d;
  const size_t lanes = hn::Lanes(d);
  for (; i + 2 * lanes <= count; i += 2 * lanes) {
    const auto low = hn::LoadU(d, bytes + i), high = hn::LoadU(d, bytes + i + lanes);
    hn::StoreU(hn::ConcatEven(d, high, low), d, even + i / 2);
    hn::StoreU(hn::ConcatOdd(d, high, low), d, odd + i / 2);
  }
#endif
  for (; i + 2 <= count; i += 2) {
    even[i / 2] = bytes[i];
    odd[i / 2] = bytes[i + 1];
  }
}

/// What each byte adds to the one before, around 128.
void Differences(const uint8_t* bytes, size_t count, uint8_t* result) {
  const hn::ScalableTag<uint8_t> d;
  const size_t lanes = hn::Lanes(d);
  result[0] = bytes[0];
  size_t i = 1;
  for (; i + lanes <= count; i += lanes) {
    const auto difference = hn::Sub(hn::LoadU(d, bytes + i), hn::LoadU(d, bytes + i - 1));
    hn::StoreU(hn::Add(difference, hn::Set(d, 128)), d, result + i);
  }
  for (; i < count; ++i) result[i] = static_cast<uint8_t>(bytes[i] - bytes[i - 1] + 128);
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {
namespace {

HWY_EXPORT(Sort);
HWY_EXPORT(Differences);

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
  sorted.resize(size);
  differences.resize(size);
  uint8_t *even = sorted.data(), *odd = even + size / 2;
  for_each_row(channels, y, lines, [&](const uint8_t* row) {
    HWY_DYNAMIC_DISPATCH(Sort)(row, row_bytes, even, odd);
    even += row_bytes / 2;
    odd += row_bytes / 2;
  });
  HWY_DYNAMIC_DISPATCH(Differences)(sorted.data(), size, differences.data());

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
#endif
