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

/// Whether checksums are held to what they are of: not where a fuzzer is to get past them (the usual macro of
/// libFuzzer's users).
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
inline constexpr bool kChecksumsHold = false;
#else
inline constexpr bool kChecksumsHold = true;
#endif

/// The EXRs that brume writes carry the CRC-32 and size of the whole file in their header, both taken with zeros in
/// their place. A file of that size with another checksum is damaged. One of another size was written anew by another
/// program, which keeps attributes that it does not know.
inline constexpr std::string_view kChecksumAttribute = "fileChecksum",
                                  kNoChecksum = "00000000 of 0000000000000000 bytes";

/// Fills in the checksum of an EXR whose header has the attribute with kNoChecksum. @throws InputError where it cannot
/// be read or written
void write_checksum(const std::filesystem::path& path);

/// For files that have the attribute, or must have it.
/// @param own  whether no other program may have written the file anew: a part or a checkpoint
/// @throws InputError: damaged; Interrupted
void verify_checksum(const std::filesystem::path& path, bool own, const Task& task = {});

}  // namespace brume
