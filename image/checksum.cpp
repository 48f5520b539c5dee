#include "image/checksum.h"

#include <fmt/format.h>
#include <libdeflate.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "base/error.h"

namespace brume {

uint32_t crc32(std::span<const std::byte> bytes, uint32_t before) {
  return libdeflate_crc32(before, bytes.data(), bytes.size());
}

namespace {

namespace fs = std::filesystem;

struct Checksum {
  std::string found, computed;  // the attribute's values; found is empty where the file has none
  size_t at = 0;                // where it stands
};

Checksum checksum_of(const fs::path& path, const Task& task) {
  constexpr size_t kBlock = 1 << 22;  // the header lies in the first
  std::ifstream file(path, std::ios::binary);
  std::vector<char> block(kBlock);
  Checksum sum;
  uint32_t crc = 0;
  uint64_t bytes = 0;
  for (bool first = true; file; first = false) {
    task.check();
    file.read(block.data(), static_cast<std::streamsize>(block.size()));
    const auto count = static_cast<size_t>(file.gcount());
    if (first) {
      // Name, type, size, value: as OpenEXR lays out an attribute.
      std::string attribute(kChecksumAttribute);
      attribute += std::string("\0string\0", 8);
      attribute += std::string({static_cast<char>(kNoChecksum.size()), 0, 0, 0});
      const size_t name = std::string_view(block.data(), count).find(attribute);
      if (name != std::string_view::npos && name + attribute.size() + kNoChecksum.size() <= count) {
        sum.at = name + attribute.size();
        sum.found.assign(block.data() + sum.at, kNoChecksum.size());
        std::memcpy(block.data() + sum.at, kNoChecksum.data(), kNoChecksum.size());
      }
    }
    crc = crc32(std::as_bytes(std::span(block.data(), count)), crc);
    bytes += count;
  }
  if (!file.eof()) throw InputError(fmt::format("{}: cannot be read: {}", path.string(), std::strerror(errno)));
  sum.computed = fmt::format("{:08x} of {:016} bytes", crc, bytes);
  return sum;
}

}  // namespace

void write_checksum(const fs::path& path) {
  const Checksum sum = checksum_of(path, {});
  std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
  file.seekp(static_cast<std::streamoff>(sum.at));
  file.write(sum.computed.data(), static_cast<std::streamsize>(sum.computed.size()));
  file.close();
  if (sum.found != kNoChecksum || !file)
    throw InputError(fmt::format("{}: cannot be written: {}", path.string(), std::strerror(errno)));
}

void verify_checksum(const fs::path& path, bool own, const Task& task) {
  const Checksum sum = checksum_of(path, task);
  if (sum.found == sum.computed || !kChecksumsHold) return;
  // Of the form of kNoChecksum, whose zeros stand for any digits.
  const bool legible = std::equal(
      sum.found.begin(), sum.found.end(), kNoChecksum.begin(), kNoChecksum.end(),
      [](char c, char like) { return like == '0' ? std::isxdigit(static_cast<unsigned char>(c)) : c == like; });
  if (!legible)
    throw InputError(
        fmt::format("{}: damaged, or written by another program: expected an attribute {} as brume writes it",
                    path.string(), kChecksumAttribute));
  const size_t digits = 8;
  if (own || sum.found.substr(digits) == sum.computed.substr(digits))
    throw InputError(fmt::format("{}: truncated or damaged: {} in its header is {}, its bytes have {}", path.string(),
                                 kChecksumAttribute, sum.found, sum.computed));
}

}  // namespace brume
