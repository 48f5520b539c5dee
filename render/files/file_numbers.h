#pragma once
#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

namespace brume {

// What readers of mesh files share.

/// A number as programs print it, whatever the locale: what a double holds, NaN and infinities as C and as Windows
/// print them (1.#QNAN, -1.#INF). Nothing where it is none.
inline std::optional<double> to_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error == std::errc::result_out_of_range) return std::strtod(std::string(word).c_str(), nullptr);
  if (error != std::errc()) return std::nullopt;
  const std::string_view rest(end, static_cast<size_t>(word.data() + word.size() - end));
  if (rest.empty()) return value;
  if (rest.starts_with("#INF")) return value * std::numeric_limits<double>::infinity();
  if (rest.starts_with("#QNAN") || rest.starts_with("#IND") || rest.starts_with("#SNAN"))
    return std::numeric_limits<double>::quiet_NaN();
  return std::nullopt;
}

inline std::optional<int64_t> to_whole_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size() ? std::optional(value) : std::nullopt;
}

inline std::string read_whole(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string bytes(static_cast<size_t>(std::filesystem::file_size(path)), '\0');
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<size_t>(file.gcount()));
  return bytes;
}

}  // namespace brume
