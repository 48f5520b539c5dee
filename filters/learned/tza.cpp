#include "filters/learned/tza.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>

#include "base/error.h"

namespace brume {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr uint16_t kMagic = 0x41D7;
constexpr size_t kMostBytes = 1u << 28;  // the largest published network has 8 MB

float float_of_half(uint16_t bits) {
  const int exponent = bits >> 10 & 31, mantissa = bits & 1023;
  const float size = exponent == 31  ? (mantissa ? NAN : INFINITY)
                     : exponent == 0 ? std::ldexp(static_cast<float>(mantissa), -24)
                                     : std::ldexp(static_cast<float>(1024 + mantissa), exponent - 25);
  return bits >> 15 ? -size : size;
}

class TzaReader {
 public:
  explicit TzaReader(const std::filesystem::path& path) : path_(path) {
    std::ifstream stream(path, std::ios::binary | std::ios::ate);
    if (!stream) fail("cannot be opened");
    const auto size = static_cast<size_t>(std::max<std::streamoff>(0, stream.tellg()));
    if (size > kMostBytes) fail(fmt::format("has {:.0f} MB, no network's weights", static_cast<double>(size) / 1e6));
    bytes_.resize(size);
    stream.seekg(0);
    if (!stream.read(bytes_.data(), static_cast<std::streamsize>(size))) fail("cannot be read");
  }

  std::map<std::string, Tensor> read() {
    if (bytes_.size() < 12 || take<uint16_t>() != kMagic) fail("is no tensor archive (TZA)");
    const int major = take<uint8_t>();
    at_ += 1;
    if (major != 2) fail(fmt::format("is a tensor archive of version {}; expected 2", major));
    at_ = take<uint64_t>();
    if (at_ > bytes_.size()) fail("is cut: its table lies beyond its end");
    std::map<std::string, Tensor> tensors;
    for (uint32_t left = take<uint32_t>(); left > 0; --left) {
      what_ = "an array's name";
      const std::string name = text(take<uint16_t>());
      what_ = "array '" + name + "'";
      if (!tensors.emplace(name, tensor()).second) fail(what_ + " is there twice");
      what_ = "the table";
    }
    return tensors;
  }

 private:
  [[noreturn]] void fail(const std::string& why) const { throw InputError(fmt::format("{}: {}", path_.string(), why)); }
  /// @return where so many bytes begin
  const char* bytes(size_t at, uint64_t count) const {
    if (at > bytes_.size() || count > bytes_.size() - at) fail(fmt::format("is cut: {} lies beyond its end", what_));
    return bytes_.data() + at;
  }
  template <class Number>
  Number take() {
    Number number;
    std::memcpy(&number, bytes(at_, sizeof number), sizeof number);
    at_ += sizeof number;
    return number;
  }
  std::string text(size_t length) {
    const std::string text(bytes(at_, length), length);
    at_ += length;
    return text;
  }

  Tensor tensor() {
    Tensor t;
    const size_t rank = take<uint8_t>();
    uint64_t count = 1;
    for (size_t i = 0; i < rank; ++i) {
      const uint32_t size = take<uint32_t>();
      if (size == 0 || size > kMostBytes) fail(fmt::format("{} has a size of {}", what_, size));
      t.sizes.push_back(static_cast<int>(size));
      count = std::min<uint64_t>(count * size, kMostBytes);
    }
    t.layout = text(rank);
    const char type = take<char>();
    if (type != 'f' && type != 'h') fail(fmt::format("{} is of type {}; expected f or h", what_, int{type}));
    const auto offset = take<uint64_t>();
    const size_t size = type == 'f' ? 4 : 2;
    const char* const from = bytes(offset, count * size);
    t.values.resize(count);
    for (size_t i = 0; i < count; ++i) {
      uint16_t half = 0;
      std::memcpy(type == 'f' ? static_cast<void*>(&t.values[i]) : &half, from + i * size, size);
      if (type == 'h') t.values[i] = float_of_half(half);
      if (!std::isfinite(t.values[i])) fail(what_ + " is not finite");
    }
    return t;
  }

  std::filesystem::path path_;
  std::string bytes_;
  size_t at_ = 0;
  std::string what_ = "the table";
};

}  // namespace

std::map<std::string, Tensor> read_tza(const std::filesystem::path& path) {
  return TzaReader(path).read();
}

}  // namespace brume
