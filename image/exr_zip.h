#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace brume {

/// Rows of 32-bit values, one after the other.
struct ExrChannel {
  const void* values;
  size_t stride;  ///< in values
};

/// Lines of a picture as a ZIP-compressed OpenEXR file holds them; a reader tells by the size whether they are packed.
/// OpenEXR would do it in twice the time, with zlib.
///
/// Source: ImfZip.cpp of OpenEXR: for each line all channels' rows; the bytes at even places, then those at odd places;
/// differences of neighbours; deflate.
/// @param channels  in the order of their names
/// @param lines     how many, from y on
/// @return the lines' plain bytes where packing does not make them fewer
std::vector<uint8_t> zip_exr_lines(std::span<const ExrChannel> channels, int width, int y, int lines);

}  // namespace brume
