#include "image/hdr_io.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <locale>
#include <optional>
#include <sstream>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/text.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

using Pixel = std::array<uint8_t, 4>;  // red, green, blue, exponent

constexpr int kMostPixels = 1 << 28;
constexpr int kLongestSide = 1 << 16;
constexpr double kMostFloat = std::numeric_limits<float>::max();
constexpr double kMostScale = 1e30;  // of an exposure, and its inverse

bool begins_as_hdr(const std::string& line) {
  return line == "#?RADIANCE" || line == "#?RGBE";
}

class HdrReader {
 public:
  explicit HdrReader(const fs::path& path) : path_(path), stream_(path, std::ios::binary) {
    if (!stream_) fail("cannot be opened");
  }

  Layers read(const Task& task, std::vector<std::string>* notes) {
    read_header();
    const dvec3 factor = 1.0 / exposure_;
    if (notes && exposure_ != dvec3(1))
      notes->push_back(
          exposure_.x == exposure_.y && exposure_.y == exposure_.z
              ? fmt::format("{}: was stored {:g} times as bright (EXPOSURE): divided by that", path_.string(),
                            exposure_.x)
              : fmt::format("{}: was stored {:g}, {:g}, {:g} times as bright (EXPOSURE, COLORCORR): divided by those",
                            path_.string(), exposure_.x, exposure_.y, exposure_.z));
    Layers layers(width_, height_);
    if (primaries_) layers.header["chromaticities"] = *primaries_;
    const auto planes = layers.add_rgb(layer::beauty);
    std::vector<Pixel> pixels(static_cast<size_t>(order_.by_columns ? height_ : width_));
    for (line_ = 0; line_ < lines(); ++line_) {
      task.check();
      read_scan_line(pixels);
      for (int i = 0; i < static_cast<int>(pixels.size()); ++i) {
        const Pixel& p = pixels[static_cast<size_t>(i)];
        int x = order_.by_columns ? line_ : i, y = order_.by_columns ? i : line_;
        if (order_.from_right) x = width_ - 1 - x;
        if (order_.from_bottom) y = height_ - 1 - y;
        const double scale = p[3] == 0 ? 0.0 : std::ldexp(1.0, p[3] - 136);
        for (size_t c = 0; c < 3; ++c)
          (*planes[c])(x, y) = static_cast<float>(std::min(p[c] * scale * factor[static_cast<int>(c)], kMostFloat));
      }
    }
    return layers;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(fmt::format("{}: {}", path_.string(), what));
  }
  [[noreturn]] void fail_in_line(const std::string& what) const {
    fail(fmt::format("{} in {} {} of {}", what, line_word(), line_ + 1, lines()));
  }
  /// Of pixels that are stored together.
  int lines() const { return order_.by_columns ? width_ : height_; }
  const char* line_word() const { return order_.by_columns ? "column" : "row"; }

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
    for (std::string line = read_line(); !line.empty(); line = read_line()) read_variable(line);
    const std::string resolution = read_line();
    std::vector<std::string> words = split(resolution, ' ');
    std::erase(words, "");
    const auto number = [](const std::string& text) -> std::optional<int> {
      int value = 0;
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
      return error == std::errc() && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
    };
    const auto axis = [](const std::string& word) {
      return word.size() == 2 && (word[0] == '+' || word[0] == '-') ? word[1] : ' ';
    };
    if (words.size() != 4 || !number(words[1]) || !number(words[3]) ||
        !((axis(words[0]) == 'Y' && axis(words[2]) == 'X') || (axis(words[0]) == 'X' && axis(words[2]) == 'Y')))
      fail(fmt::format("its resolution line is '{}'; expected '-Y height +X width', or another order of these two axes",
                       resolution));
    order_.by_columns = axis(words[0]) == 'X';
    const size_t x = order_.by_columns ? 0 : 2, y = 2 - x;
    // The axes point right and up: rows from the top are at falling Y.
    order_.from_right = words[x][0] == '-';
    order_.from_bottom = words[y][0] == '+';
    width_ = *number(words[x + 1]);
    height_ = *number(words[y + 1]);
    if (width_ < 1 || height_ < 1 || width_ > kLongestSide || height_ > kLongestSide ||
        static_cast<int64_t>(width_) * height_ > kMostPixels)
      fail(fmt::format("is {} x {} pixels; expected 1 .. {} on a side and at most {} in all", width_, height_,
                       kLongestSide, kMostPixels));
    const auto left = fs::file_size(path_) - static_cast<uint64_t>(stream_.tellg());
    if (left < sizeof(Pixel) * static_cast<uint64_t>(lines()))
      fail(fmt::format("truncated: {} bytes follow its header, too few for {} {}s", left, lines(), line_word()));
  }

  /// NAME=VALUE of the header; all others are comments or a program's own.
  void read_variable(const std::string& line) {
    const size_t equals = line.find('=');
    if (equals == std::string::npos) return;
    const std::string name = line.substr(0, equals), value = line.substr(equals + 1);
    if (name == "FORMAT") {
      const std::string format = value.substr(std::min(value.find_first_not_of(' '), value.size()));
      if (format == "32-bit_rle_xyze")
        fail(
            "its format is '32-bit_rle_xyze', luminances in CIE XYZ; expected 32-bit_rle_rgbe, to which Radiance's ra_xyze -r -o converts it");
      if (format != "32-bit_rle_rgbe") fail(fmt::format("its format is '{}'; expected 32-bit_rle_rgbe", format));
    } else if (name == "EXPOSURE") {
      exposure_ *= numbers<1>(line, value, "a number above 0")[0];
    } else if (name == "COLORCORR") {
      const auto factors = numbers<3>(line, value, "three numbers above 0");
      exposure_ *= dvec3(factors[0], factors[1], factors[2]);
    } else if (name == "PRIMARIES") {
      const auto xy = numbers<8>(line, value, "x, y of red, green, blue and white");
      primaries_.emplace();
      std::copy(xy.begin(), xy.end(), primaries_->begin());
      return;
    }
    if (!(exposure_.x > 0 && exposure_.y > 0 && exposure_.z > 0))
      fail(fmt::format("{}: expected numbers above 0", line));
    const dvec3 size = glm::max(exposure_, 1.0 / exposure_);
    if (!(max_component(size) < kMostScale))
      fail(fmt::format("its exposure becomes {:g} by '{}'; expected one that radiance can have", exposure_.x, line));
  }
  template <size_t N>
  std::array<double, N> numbers(const std::string& line, const std::string& value, const char* expected) const {
    std::array<double, N> result{};
    std::istringstream words(value);
    words.imbue(std::locale::classic());
    for (double& number : result) words >> number;
    if (!words) fail(fmt::format("{}: expected {}", line, expected));
    return result;
  }

  uint8_t read_byte() {
    const int c = stream_.get();
    if (c == std::char_traits<char>::eof()) fail_in_line("truncated: the file ends");
    return static_cast<uint8_t>(c);
  }
  Pixel read_pixel() {
    Pixel p;
    for (uint8_t& byte : p) byte = read_byte();
    return p;
  }

  void read_scan_line(std::vector<Pixel>& pixels) {
    const Pixel first = read_pixel();
    const bool may_be_new = pixels.size() >= 8 && pixels.size() < (1 << 15);
    if (may_be_new && first[0] == 2 && first[1] == 2 && first[2] < 128) {
      if (const size_t length = first[2] * 256u + first[3]; length != pixels.size())
        fail_in_line(fmt::format("damaged: a scan line of {} pixels, expected {},", length, pixels.size()));
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
        fail_in_line(fmt::format("damaged: {} values where {} are left", count, pixels.size() - x));
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
          fail_in_line(fmt::format("damaged: a run of {} pixels after {} of {}", count, x, pixels.size()));
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
  struct Order {
    bool by_columns = false, from_right = false, from_bottom = false;
  } order_;            // of the pixels
  dvec3 exposure_{1};  // EXPOSURE and COLORCORR lines, multiplied
  std::optional<Chromaticities> primaries_;
  int width_ = 0, height_ = 0, line_ = 0;
};

}  // namespace

bool is_hdr(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::string beginning(10, '\0');
  stream.read(beginning.data(), static_cast<std::streamsize>(beginning.size()));
  return beginning.starts_with("#?RADIANCE") || beginning.starts_with("#?RGBE");
}

Layers read_hdr(const fs::path& path, const Task& task, std::vector<std::string>* notes) try {
  std::error_code ignored;
  check_exists(path);
  if (!fs::is_regular_file(path, ignored))
    throw InputError(fmt::format("{}: is no regular file, expected a Radiance HDR picture", path.string()));
  return HdrReader(path).read(task, notes);
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

}  // namespace brume
