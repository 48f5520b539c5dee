#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace brume {

/// Text as TOML has it, in quotes, with escapes for quotes, backslashes and control characters. TOML is UTF-8 alone:
/// another byte, as names of files may hold it, becomes the private character U+EF00 + byte, of which toml_path() makes
/// the byte again.
std::string toml_string(std::string_view text);

/// A key, in quotes where it needs them.
std::string toml_key(std::string_view key);

/// The file that a text of TOML names from a folder on: its bytes of toml_string() are put back, unless a file has the
/// very name.
std::filesystem::path toml_path(const std::filesystem::path& folder, const std::string& text);

/// The shortest text that is read as this very number; with a point or an exponent, so that it is no integer.
std::string toml_number(double value);

/// Text for a comment: what ends a line, or TOML forbids there, becomes a space.
std::string toml_comment(std::string_view text);

}  // namespace brume
