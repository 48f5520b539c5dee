#include "base/sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdint>

#include "base/error.h"
#include "base/text.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr int kMostDigits = 9;              // of a frame's number
constexpr size_t kMostFrames = 10'000'000;  // in one list

bool is_digit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

/// A number's place in a name.
struct Place {
  size_t begin, length;
  int digits;
};

/// The place that begins at `at`; nothing where none does.
std::optional<Place> place_at(std::string_view name, size_t at) {
  const auto number = [&](size_t& i) {
    size_t value = 0;
    for (; i < name.size() && is_digit(name[i]); ++i) value = std::min<size_t>(10 * value + (name[i] - '0'), 1000);
    return static_cast<int>(value);
  };
  const auto place = [&](size_t end, int digits) {
    if (digits > kMostDigits)
      throw InputError(fmt::format("{}: {} asks for {} digits; a frame's number has at most {}", name,
                                   name.substr(at, end - at), digits, kMostDigits));
    return Place{at, end - at, digits};
  };
  const std::string_view rest = name.substr(at);
  // One @ alone is part of many names (icon@2x).
  if (rest.starts_with('#') || rest.starts_with("@@")) {
    const size_t end = std::min(name.find_first_not_of(rest.front(), at), name.size());
    return place(end, static_cast<int>(std::min<size_t>(end - at, 1000)));
  }
  if (rest.starts_with("<frame>")) return place(at + 7, 0);
  if (rest.starts_with("<F") || rest.starts_with("<f")) {
    size_t i = at + 2;
    const int digits = number(i);
    if (i < name.size() && name[i] == '>') return place(i + 1, digits);
  }
  if (rest.starts_with("${F")) {
    size_t i = at + 3;
    const int digits = number(i);
    if (i < name.size() && name[i] == '}') return place(i + 1, digits);
  } else if (rest.starts_with("$F")) {
    size_t i = at + 2;
    const int digits = number(i);
    // $FF and $FPS are other variables.
    if (i > at + 2 || i == name.size() || !std::isalpha(static_cast<unsigned char>(name[i]))) return place(i, digits);
  } else if (rest.starts_with('%')) {
    size_t i = at + 1;
    const bool zeros = i < name.size() && name[i] == '0';
    const int digits = number(i);
    if (i < name.size() && name[i] == 'd' && (zeros || digits == 0)) return place(i + 1, digits);
  }
  return std::nullopt;
}

std::vector<Place> places_in(std::string_view name) {
  std::vector<Place> places;
  for (size_t at = 0; at < name.size();) {
    const std::optional<Place> place = place_at(name, at);
    if (place) places.push_back(*place);
    at += place ? place->length : 1;
  }
  return places;
}

std::string with_number(std::string_view name, int frame) {
  std::string text;
  size_t done = 0;
  for (const Place& place : places_in(name)) {
    text += fmt::format("{}{:0{}}", name.substr(done, place.begin - done), frame, place.digits);
    done = place.begin + place.length;
  }
  return text + std::string(name.substr(done));
}

/// The number with which `pattern` becomes `name`.
std::optional<int> number_in(const std::string& name, const std::string& pattern, size_t first_place) {
  if (name.compare(0, first_place, pattern, 0, first_place) != 0) return std::nullopt;
  int number = 0;
  for (size_t i = first_place; i < std::min(name.size(), first_place + kMostDigits) && is_digit(name[i]); ++i) {
    number = 10 * number + (name[i] - '0');
    if (with_number(pattern, number) == name) return number;
  }
  return std::nullopt;
}

}  // namespace

std::optional<FramePattern> FramePattern::of(const fs::path& name) {
  if (places_in(name.string()).empty()) return std::nullopt;
  return FramePattern(name);
}

fs::path FramePattern::path(int frame) const {
  return with_number(name_.string(), frame);
}

std::vector<int> FramePattern::frames_on_disk() const {
  fs::path folder;
  std::vector<int> frames;
  for (const fs::path& piece : name_) {
    const std::vector<Place> places = places_in(piece.string());
    if (places.empty()) {
      folder /= piece;
      continue;
    }
    std::error_code error;
    for (fs::directory_iterator entry(folder.empty() ? "." : folder, error), end; !error && entry != end;
         entry.increment(error)) {
      const std::optional<int> frame =
          number_in(entry->path().filename().string(), piece.string(), places.front().begin);
      std::error_code ignored;
      if (frame && fs::exists(path(*frame), ignored)) frames.push_back(*frame);
    }
    break;
  }
  std::sort(frames.begin(), frames.end());
  return frames;
}

fs::path file_of_frame(const fs::path& name, int frame) {
  const std::optional<FramePattern> pattern = FramePattern::of(name);
  return pattern ? pattern->path(frame) : name;
}

void check_pattern(std::string_view what, const fs::path& name, std::span<const int> frames) {
  if (frames.size() > 1 && !name.empty() && !FramePattern::of(name))
    throw InputError(fmt::format("{} {}: all {} frames would go into one file; expected a name such as shot.####.exr",
                                 what, name.string(), frames.size()));
}

std::vector<int> parse_frames(std::string_view text) {
  std::vector<int> frames;
  for (const std::string& piece : split(text, ',')) {
    const auto fail = [&](const std::string& found) {
      throw InputError(
          fmt::format("frames '{}': {}; expected 7, 1-240, 1-240x2, or several with commas between them", text, found));
    };
    const size_t begin = std::min(piece.find_first_not_of(' '), piece.size());
    const std::string_view range = std::string_view(piece).substr(begin, piece.find_last_not_of(' ') + 1 - begin);
    size_t at = 0;
    const auto number = [&]() -> int {
      const size_t start = at;
      int value = 0;
      for (; at < range.size() && is_digit(range[at]); ++at) {
        if (at - start == kMostDigits) fail(fmt::format("'{}' has a number above {}", range, 999'999'999));
        value = 10 * value + (range[at] - '0');
      }
      if (at == start)
        fail(range.empty()            ? "a frame is missing"
             : range.starts_with('-') ? fmt::format("'{}' is below 0, where no frames are", range)
             : start == range.size()  ? fmt::format("'{}' breaks off", range)
                                      : fmt::format("'{}' is not a number", range.substr(start)));
      return value;
    };
    const int first = number();
    const auto follows = [&](char sign) { return at < range.size() && range[at] == sign && ++at > 0; };
    const int last = follows('-') ? number() : first;
    const int step = follows('x') ? number() : 1;
    if (at < range.size()) fail(fmt::format("'{}' goes on with '{}'", range, range.substr(at)));
    if (last < first) fail(fmt::format("'{}' ends before it begins", range));
    if (step < 1) fail(fmt::format("'{}' has a step of 0", range));
    if (frames.size() + static_cast<size_t>((last - first) / step) >= kMostFrames)
      fail(fmt::format("'{}' makes them more than {}", range, kMostFrames));
    for (int64_t frame = first; frame <= last; frame += step) frames.push_back(static_cast<int>(frame));
  }
  std::sort(frames.begin(), frames.end());
  frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
  return frames;
}

std::vector<int> frames_or_all_of(const fs::path& name, std::string_view text) {
  if (!text.empty()) return parse_frames(text);
  std::error_code ignored;
  const std::optional<FramePattern> pattern = FramePattern::of(name);
  return pattern && !fs::exists(name, ignored) ? pattern->frames_on_disk() : std::vector<int>();
}

std::vector<int> frames_to_make(const fs::path& source, const fs::path& output, std::string_view text,
                                const std::array<std::string_view, 2>& what) {
  if (!text.empty()) return parse_frames(text);
  const std::string name = output.string();
  if (!FramePattern::of(output) || std::count(name.begin(), name.end(), '#') == 1) return {};
  std::vector<int> frames = frames_or_all_of(source);
  if (frames.empty())
    throw InputError(
        fmt::format("{} {}: a name for a sequence, of one frame; expected {}, as 1-240", what[0], name, what[1]));
  return frames;
}

std::string frames_text(std::span<const int> frames) {
  std::vector<std::string> ranges;
  for (size_t i = 0; i < frames.size();) {
    size_t end = i + 1;
    while (end < frames.size() && frames[end] == frames[end - 1] + 1) ++end;
    ranges.push_back(end - i == 1 ? fmt::format("{}", frames[i]) : fmt::format("{}-{}", frames[i], frames[end - 1]));
    i = end;
  }
  return join(ranges);
}

}  // namespace brume
