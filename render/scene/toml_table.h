#pragma once
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <istream>
#include <string>
#include <type_traits>
#include <vector>
#if __has_include(<toml11/skip.hpp>)
#include <toml11/skip.hpp>

// toml11 4.4 never leaves a comment that it meets after an error in the text: this takes the place of its function.
template <>
inline void toml::detail::skip_comment_block(location& at, const context<type_config>& context) {
  for (; !at.eof(); at.advance()) {
    skip_whitespace(at, context);
    if (at.current() == '#')
      while (!at.eof() && at.current() != '\n') at.advance();
    else if (at.current() != '\r' && at.current() != '\n')
      return;
  }
}
#endif
#include <toml.hpp>

#include "base/missing_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "base/toml_text.h"
#include "render/scene/scene_fields.h"

namespace brume {

/// @throws InputError that underlines the place in its line
[[noreturn]] void fail_at(const std::string& message, const toml::value& at, const std::string& expected);

/// "a number", "text", "a table", ...
const char* toml_type_name(const toml::value& value);

/// A value as a scene has it: on one line, text escaped, numbers as short as they can be.
std::string toml_text(const toml::value& value);

/// ", at least 1" or " in 0 .. 1"; empty where there are no bounds.
std::string toml_range_text(const Field& field);

/// Where a value stands in the text that it was read from; line and column count from 1.
struct TomlPlace {
  size_t line, column, length;
};
TomlPlace toml_place(const toml::value& value);

/// @throws InputError, with line and column, for what is no TOML
toml::value parse_toml(std::istream& stream, const std::string& name);

/// Sets a key of a scene: "camera.fov=30", "volumes.0.sigma_t=5". TOML values, or bare text for strings. Tables that
/// are not there are made; an index one past the end of a list adds an entry.
/// @throws InputError
void apply_assignment(toml::value& root, const std::string& assignment);

/// Reads one table's keys into their targets, as the fields of their declarations say.
class TomlTable {
 public:
  /// @param frame  whose files are meant by names with a place for its number
  TomlTable(const toml::value& table, std::string where, const std::filesystem::path& folder, int frame = 0)
      : table_(table), where_(std::move(where)), folder_(folder), frame_(frame) {
    if (!table.is_table()) fail_at(where_ + " is " + toml_type_name(table), table, "expected a table");
  }

  template <class T>
  void operator()(const Field& field, T& target) {
    known_.push_back(field.key);
    const auto& entries = table_.as_table();
    const auto it = entries.find(field.key);
    if (it != entries.end()) {
      read(field, it->second, target);
    } else if (field.required && std::find(provided_.begin(), provided_.end(), field.key) == provided_.end()) {
      fail_at(fmt::format("{} has no '{}'", where_, field.key), table_,
              fmt::format("add {} = ... here: {}", field.key, field.help));
    }
  }

  /// A required key whose value comes from elsewhere.
  void provides(const char* key) { provided_.push_back(key); }

  /// Keys that are read elsewhere.
  void knows(std::initializer_list<const char*> keys) { known_.insert(known_.end(), keys.begin(), keys.end()); }

  bool has(const char* key) const { return table_.contains(key); }

  void reject_unknown() const {
    for (const auto& [key, value] : table_.as_table())
      if (std::find(known_.begin(), known_.end(), key) == known_.end())
        fail_at(fmt::format("unknown key '{}' in {}{}", key, where_, suggestion(key, known_)), value,
                "not a key of " + where_);
  }

  /// A file's name as it is written, with its frame's number in place: absolute. Empty where the key is not there.
  std::filesystem::path name_of_file(const std::string& key) const {
    for (const NamedFile& file : files_)
      if (file.key == key) return file.name;
    return {};
  }
  /// Has another file of that name's sequence checked.
  void take_file(const std::string& key, const std::filesystem::path& path) {
    for (NamedFile& file : files_)
      if (file.key == key) file.path = path;
  }

  /// Last, so that what the table itself gets wrong is said first.
  void check_files() const {
    std::error_code ignored;
    for (const auto& [key, path, name] : files_)
      if (!std::filesystem::exists(path, ignored))
        fail_at(fmt::format("'{}' of {} is {}: {}", key, where_, path.string(), missing_file(path)), table_.at(key),
                "expected a file; its path starts at the folder of the file that names it");
  }

 private:
  static double number(const Field& field, const toml::value& v) {
    double x;
    if (v.is_integer())
      x = static_cast<double>(v.as_integer());
    else if (v.is_floating())
      x = v.as_floating();
    else
      fail_at(fmt::format("'{}' is {}", field.key, toml_type_name(v)), v, "expected a number" + toml_range_text(field));
    if (!(x >= field.lowest && x <= field.highest) || !std::isfinite(x))
      fail_at(fmt::format("'{}' is out of range", field.key), v, "expected a finite number" + toml_range_text(field));
    return x;
  }
  static void read(const Field& field, const toml::value& v, double& target) { target = number(field, v); }
  template <class Integer>
  requires std::is_integral_v<Integer>
  static void read(const Field& field, const toml::value& v, Integer& target) {
    if (!v.is_integer())
      fail_at(fmt::format("'{}' is {}", field.key, toml_type_name(v)), v,
              "expected an integer" + toml_range_text(field));
    number(field, v);
    target = static_cast<Integer>(v.as_integer());
  }
  static void read(const Field& field, const toml::value& v, bool& target) {
    if (!v.is_boolean()) fail_at(fmt::format("'{}' is {}", field.key, toml_type_name(v)), v, "expected true or false");
    target = v.as_boolean();
  }
  static void read(const Field& field, const toml::value& v, std::string& target) {
    if (!v.is_string()) fail_at(fmt::format("'{}' is {}", field.key, toml_type_name(v)), v, "expected text in quotes");
    target = toml::get<std::string>(v);
    if (!field.choices.empty() && std::find(field.choices.begin(), field.choices.end(), target) == field.choices.end())
      fail_at(fmt::format("'{}' cannot be '{}'{}", field.key, target, suggestion(target, field.choices)), v,
              "expected one of these");
  }
  void read(const Field& field, const toml::value& v, std::filesystem::path& target) {
    std::string text;
    read(field, v, text);
    if (text.empty()) return;
    std::error_code ignored;
    target = toml_path(folder_, text);
    // "take##.vdb" may be a name too.
    if (!std::filesystem::exists(target, ignored)) target = toml_path(folder_, file_of_frame(text, frame_).string());
    files_.push_back({field.key, target, toml_path(folder_, text)});
  }
  template <class Table>
  requires std::is_same_v<Table, VolumeTime> || std::is_same_v<Table, VolumeDetail>
  void read(const Field& field, const toml::value& v, Table& target) {
    TomlTable table(v, fmt::format("'{}' of {}", field.key, where_), folder_, frame_);
    describe(table, target);
    table.reject_unknown();
    target.given = true;
  }
  static void read(const Field& field, const toml::value& v, dvec3& target) {
    const std::string expected = "expected [x, y, z]" + toml_range_text(field);
    if (v.is_integer() || v.is_floating()) {
      if (std::string(field.unit).empty() || std::string(field.unit) == "scene units")
        fail_at(fmt::format("'{}' is a number", field.key), v, expected);
      target = dvec3(number(field, v));  // a grey colour
      return;
    }
    if (!v.is_array() || v.as_array().size() != 3)
      fail_at(fmt::format("'{}' is {}", field.key,
                          v.is_array() ? fmt::format("an array of {}", v.as_array().size()) : toml_type_name(v)),
              v, expected);
    for (int i = 0; i < 3; ++i) target[i] = number(field, v.as_array()[static_cast<size_t>(i)]);
  }
  static void read(const Field& field, const toml::value& v, dvec2& target) {
    if (!v.is_array() || v.as_array().size() != 2)
      fail_at(fmt::format("'{}' is not two numbers", field.key), v,
              "expected [first, second]" + toml_range_text(field));
    for (int i = 0; i < 2; ++i) target[i] = number(field, v.as_array()[static_cast<size_t>(i)]);
  }
  static void read(const Field& field, const toml::value& v, std::vector<double>& target) {
    if (!v.is_array() || (!v.as_array().empty() && v.as_array().size() != 3))
      fail_at(fmt::format("'{}' is not three numbers", field.key), v, "expected [x, y, z]" + toml_range_text(field));
    for (const toml::value& entry : v.as_array()) target.push_back(number(field, entry));
  }
  static const toml::array& list(const Field& field, const toml::value& v, const char* expected) {
    if (!v.is_array()) fail_at(fmt::format("'{}' is {}", field.key, toml_type_name(v)), v, expected);
    return v.as_array();
  }
  static void read(const Field& field, const toml::value& v, std::vector<int>& target) {
    target.clear();
    for (const toml::value& entry : list(field, v, "expected integers in brackets"))
      read(field, entry, target.emplace_back());
  }
  static void read(const Field& field, const toml::value& v, std::vector<std::string>& target) {
    target.clear();
    for (const toml::value& entry : list(field, v, "expected texts in brackets"))
      read(field, entry, target.emplace_back());
  }
  void read(const Field& field, const toml::value& v, std::vector<std::filesystem::path>& target) {
    target.clear();
    for (const toml::value& entry : list(field, v, "expected file names in brackets"))
      read(field, entry, target.emplace_back());
  }
  static void read(const Field& field, const toml::value& v, std::vector<std::vector<double>>& target) {
    const std::string key = field.key;
    const size_t columns = key == "keys" ? 7 : key == "flame_ramp" ? 4 : 2;
    const std::string expected = fmt::format("expected at least two rows of {} numbers, rising in the first", columns);
    if (!v.is_array()) fail_at(fmt::format("'{}' is {}", field.key, toml_type_name(v)), v, expected);
    for (const toml::value& row : v.as_array()) {
      if (!row.is_array() || row.as_array().size() != columns)
        fail_at(fmt::format("'{}' has a row that is not {} numbers", field.key, columns), row, expected);
      std::vector<double> numbers;
      for (const toml::value& entry : row.as_array()) numbers.push_back(number(field, entry));
      if (!target.empty() && !(numbers[0] > target.back()[0]))
        fail_at(fmt::format("'{}' does not rise", field.key), row, expected);
      for (size_t i = 1; i < columns; ++i)
        if (numbers[i] < 0 && key != "keys")
          fail_at(fmt::format("'{}' has a negative result", field.key), row, expected);
      target.push_back(numbers);
    }
    if (target.size() == 1) fail_at(fmt::format("'{}' has one row", field.key), v, expected);
  }
  static void read(const Field& field, const toml::value& v, std::vector<dmat4>& target) {
    target.clear();
    for (const toml::value& entry : list(field, v, "expected [matrix, ...], each four rows of four numbers"))
      read(field, entry, target.emplace_back());
    if (target.empty()) fail_at(fmt::format("'{}' is empty", field.key), v, "expected at least one matrix");
  }
  static void read(const Field& field, const toml::value& v, dmat4& target) {
    const std::string expected = "expected four rows of four numbers";
    if (!v.is_array() || v.as_array().size() != 4)
      fail_at(fmt::format("'{}' is not a 4 x 4 matrix", field.key), v, expected);
    for (int row = 0; row < 4; ++row) {
      const toml::value& line = v.as_array()[static_cast<size_t>(row)];
      if (!line.is_array() || line.as_array().size() != 4)
        fail_at(fmt::format("'{}' has a row that is not four numbers", field.key), line, expected);
      for (int column = 0; column < 4; ++column)
        target[column][row] = number(field, line.as_array()[static_cast<size_t>(column)]);
    }
  }

  struct NamedFile {
    std::string key;
    std::filesystem::path path, name;
  };

  const toml::value& table_;
  std::string where_;
  std::filesystem::path folder_;
  int frame_;
  std::vector<std::string> known_, provided_;
  std::vector<NamedFile> files_;
};

}  // namespace brume
