#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>

#include "base/progress.h"

namespace brume {

/// CRC-32 of bytes, going on from that of the bytes before them.
uint32_t crc32(std::span<const std::byte> bytes, uint32_t before = 0);

/// Frames that hold the sums of their samples carry a checksum of the whole file in their header, so that no flipped
/// bit is ever merged or rendered on. Other frames have none: other programs change them and keep their attributes.
///
/// The attribute's value is the file's CRC-32 in hexadecimal digits, taken with eight zeros in their place.
inline constexpr std::string_view kChecksumAttribute = "fileChecksum", kNoChecksum = "00000000";

/// Fills in the checksum of an EXR whose header has the attribute with kNoChecksum. @throws InputError where it cannot
/// be read or written
void write_checksum(const std::filesystem::path& path);

/// @throws InputError: the attribute is missing, or says otherwise than the file; Interrupted
void verify_checksum(const std::filesystem::path& path, const Task& task = {});

}  // namespace brume
