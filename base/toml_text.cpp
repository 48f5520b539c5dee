#include "base/toml_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

bool is_control(unsigned char byte) {
  return byte < 0x20 || byte == 0x7f;
}

/// Bytes of the UTF-8 character that a text begins with; 0 where it begins with none.
size_t character_size(std::string_view text) {
  const auto byte = [&](size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u; };
  const auto continues = [&](size_t i) { return (byte(i) & 0xc0) == 0x80; };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  if (first >= 0xc2 && first < 0xe0) return continues(1) ? 2 : 0;
  if (first >= 0xe0 && first < 0xf0) {
    const bool overlong = first == 0xe0 && byte(1) < 0xa0, surrogate = first == 0xed && byte(1) >= 0xa0;
    return continues(1) && continues(2) && !overlong && !surrogate ? 3 : 0;
  }
  if (first >= 0xf0 && first < 0xf5) {
    const bool overlong = first == 0xf0 && byte(1) < 0x90, beyond = first == 0xf4 && byte(1) >= 0x90;
    return continues(1) && continues(2) && continues(3) && !overlong && !beyond ? 4 : 0;
  }
  return 0;
}

/// @param character  what becomes of one   @param foreign  what of a byte that is none of UTF-8
template <class Character, class Foreign>
std::string rewritten(std::string_view text, const Character& character, const Foreign& foreign) {
  std::string result;
  while (!text.empty()) {
    const size_t size = character_size(text);
    result += size > 0 ? character(text.substr(0, size)) : foreign(static_cast<unsigned char>(text[0]));
    text.remove_prefix(size > 0 ? size : 1);
  }
  return result;
}

}  // namespace

std::string toml_string(std::string_view text) {
  const auto escaped = [](std::string_view c) {
    if (c == "\"" || c == "\\") return fmt::format("\\{}", c);
    return is_control(static_cast<unsigned char>(c[0])) ? fmt::format("\\u{:04X}", static_cast<int>(c[0]))
                                                        : std::string(c);
  };
  return '"' + rewritten(text, escaped, [](unsigned char byte) { return fmt::format("\\uEF{:02X}", byte); }) + '"';
}

std::filesystem::path toml_path(const std::filesystem::path& folder, const std::string& text) {
  std::filesystem::path path = folder / text;
  std::error_code ignored;
  if (std::filesystem::exists(path, ignored)) return path;
  // U+EF80 .. U+EFFF are EE BE 80 .. EE BF BF.
  return folder / rewritten(
                      text,
                      [](std::string_view c) {
                        const bool ours = c.size() == 3 && c[0] == '\xee' && (c[1] == '\xbe' || c[1] == '\xbf');
                        return ours ? std::string(1, static_cast<char>((c[1] == '\xbe' ? 0x80 : 0xc0) | (c[2] & 0x3f)))
                                    : std::string(c);
                      },
                      [](unsigned char byte) { return std::string(1, static_cast<char>(byte)); });
}

std::string toml_key(std::string_view key) {
  const auto bare = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  };
  return !key.empty() && std::all_of(key.begin(), key.end(), bare) ? std::string(key) : toml_string(key);
}

std::string toml_number(double value) {
  if (std::isnan(value)) return "nan";
  std::string text = fmt::format("{}", value);
  if (std::isfinite(value) && text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

std::string toml_comment(std::string_view text) {
  return rewritten(
      text, [](std::string_view c) { return is_control(static_cast<unsigned char>(c[0])) ? " " : std::string(c); },
      [](unsigned char) { return "?"; });
}

}  // namespace brume
