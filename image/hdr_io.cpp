#include "image/hdr_io.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>

#include "base/error.h"
#include "base/text.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

using Pixel = std::array<uint8_t, 4>;  // red, green, blue, exponent

constexpr int kMostPixels = 1 << 28;
constexpr int kLongestSide = 1 << 16;

bool begins_as_hdr(const std::string& line) {
  return line == "#?RADIANCE" || line == "#?RGBE";
}

class HdrReader {
 public:
  explicit HdrReader(const fs::path& path) : path_(path), stream_(path, std::ios::binary) {
    if (!stream_) fail("cannot be opened");
  }

  Layers read(const Task& task) {
    read_header();
    Layers layers(width_, height_);
    const auto planes = layers.add_rgb(layer::beauty);
    std::vector<Pixel> pixels(static_cast<size_t>(width_));
    for (row_ = 0; row_ < height_; ++row_) {
      task.check();
      read_scan_line(pixels);
      for (int x = 0; x < width_; ++x) {
        const Pixel& p = pixels[static_cast<size_t>(x)];
        const float scale = p[3] == 0 ? 0.0f : std::ldexp(1.0f, p[3] - 136);
        for (size_t c = 0; c < 3; ++c) (*planes[c])(x, row_) = static_cast<float>(p[c]) * scale;
      }
    }
    return layers;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(fmt::format("{}: {}", path_.string(), what));
  }
  [[noreturn]] void fail_in_row(const std::string& what) const {
    fail(fmt::format("{} in row {} of {}", what, row_ + 1, height_));
  }

  std::string read_line() {
    constexpr size_t kLongestLine = 4096;
    std::string line;
    for (int c = stream_.get(); c != '\n'; c = stream_.get()) {
      if (c == std::char_traits<char>::eof()) fail("truncated: the file ends in its header");
      line += static_cast<char>(c);
      if (line.size() > kLongestLine) fail("not a Radiance HDR file: a line of its header has no end");
    }
    if (line.ends_with('\r')) line.pop_back();
    return line;
  }

  void read_header() {
    if (const std::string first = read_line(); !begins_as_hdr(first))
      fail("not a Radiance HDR file; expected it to begin with #?RADIANCE");
    for (std::string line = read_line(); !line.empty(); line = read_line())
      if (line.starts_with("FORMAT=") && line != "FORMAT=32-bit_rle_rgbe")
        fail(fmt::format("its format is '{}'; expected 32-bit_rle_rgbe", line.substr(7)));
    const std::string resolution = read_line();
    const std::vector<std::string> words = split(resolution, ' ');
    const auto number = [](const std::string& text) -> std::optional<int> {
      int value = 0;
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
      return error == std::errc() && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
    };
    if (words.size() != 4 || words[0] != "-Y" || words[2] != "+X" || !number(words[1]) || !number(words[3]))
      fail(fmt::format(
          "its resolution line is '{}'; expected '-Y height +X width', rows from the top, pixels from the left",
          resolution));
    height_ = *number(words[1]);
    width_ = *number(words[3]);
    if (width_ < 1 || height_ < 1 || width_ > kLongestSide || height_ > kLongestSide ||
        static_cast<int64_t>(width_) * height_ > kMostPixels)
      fail(fmt::format("is {} x {} pixels; expected 1 .. {} on a side and at most {} in all", width_, height_,
                       kLongestSide, kMostPixels));
    const auto left = fs::file_size(path_) - static_cast<uint64_t>(stream_.tellg());
    if (left < sizeof(Pixel) * static_cast<uint64_t>(height_))
      fail(fmt::format("truncated: {} bytes follow its header, too few for {} rows", left, height_));
  }

  uint8_t read_byte() {
    const int c = stream_.get();
    if (c == std::char_traits<char>::eof())
      fail(fmt::format("truncated: the file ends in row {} of {}", row_ + 1, height_));
    return static_cast<uint8_t>(c);
  }
  Pixel read_pixel() {
    Pixel p;
    for (uint8_t& byte : p) byte = read_byte();
    return p;
  }

  void read_scan_line(std::vector<Pixel>& pixels) {
    const Pixel first = read_pixel();
    const bool may_be_new = width_ >= 8 && width_ < (1 << 15);
    if (may_be_new && first[0] == 2 && first[1] == 2 && first[2] < 128) {
      if (const int length = first[2] * 256 + first[3]; length != width_)
        fail_in_row(fmt::format("damaged: a scan line of {} pixels, expected {},", length, width_));
      for (size_t c = 0; c < 4; ++c) read_component(pixels, c);
    } else {
      read_old(first, pixels);
    }
  }

  /// One of the four bytes of all pixels of a line: runs of one value, and stretches of different ones.
  void read_component(std::vector<Pixel>& pixels, size_t component) {
    for (size_t x = 0; x < pixels.size();) {
      const int code = read_byte();
      const bool run = code > 128;
      const size_t count = static_cast<size_t>(run ? code - 128 : code);
      if (count == 0 || count > pixels.size() - x)
        fail_in_row(fmt::format("damaged: {} values where {} are left", count, pixels.size() - x));
      uint8_t value = run ? read_byte() : uint8_t{0};
      for (const size_t end = x + count; x < end; ++x) {
        if (!run) value = read_byte();
        pixels[x][component] = value;
      }
    }
  }

  /// Pixels one by one; 1, 1, 1, n stands for n more of the last, and a further one right after it for 256 n more.
  void read_old(Pixel next, std::vector<Pixel>& pixels) {
    size_t x = 0;
    int shift = 0;
    while (true) {
      if (next[0] == 1 && next[1] == 1 && next[2] == 1) {
        const size_t count = shift < 32 ? static_cast<size_t>(next[3]) << shift : pixels.size() + 1;
        if (x == 0 || count > pixels.size() - x)
          fail_in_row(fmt::format("damaged: a run of {} pixels after {} of {}", count, x, pixels.size()));
        std::fill_n(pixels.begin() + static_cast<std::ptrdiff_t>(x), count, pixels[x - 1]);
        x += count;
        shift += 8;
      } else {
        pixels[x] = next;
        ++x;
        shift = 0;
      }
      if (x == pixels.size()) return;
      next = read_pixel();
    }
  }

  fs::path path_;
  std::ifstream stream_;
  int width_ = 0, height_ = 0, row_ = 0;
};

}  // namespace

bool is_hdr(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::string beginning(10, '\0');
  stream.read(beginning.data(), static_cast<std::streamsize>(beginning.size()));
  return beginning.starts_with("#?RADIANCE") || beginning.starts_with("#?RGBE");
}

Layers read_hdr(const fs::path& path, const Task& task) try {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) throw InputError(fmt::format("{}: no such file", path.string()));
  if (!fs::is_regular_file(path, ignored))
    throw InputError(fmt::format("{}: is no regular file, expected a Radiance HDR picture", path.string()));
  return HdrReader(path).read(task);
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

}  // namespace brume
