#include "render/scene/instance_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/rng.h"
#include "base/text.h"
#include "render/files/file_numbers.h"
#include "render/files/ply_file.h"
#include "volume/placement.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMost = 1 << 22;  // places of one entry

[[noreturn]] void fail_for_count(const std::string& name, size_t count) {
  throw InputError(fmt::format("{}: {} places; expected at most {}", name, count, kMost));
}

/// A word of a column that has text.
struct Text {
  std::string word;  ///< in quotes
  size_t row = 0;
};

/// Numbers in named columns.
struct Table {
  std::vector<std::string> columns;
  std::vector<double> values;                   ///< row by row; not a number where there is text
  std::string row_name;                         ///< "line" or "point"
  std::vector<size_t> rows_at;                  ///< what each row is counted as; empty: from 1
  std::vector<std::optional<Text>> first_text;  ///< of each column; none where there are numbers alone

  size_t rows() const { return columns.empty() ? 0 : values.size() / columns.size(); }
  size_t row_number(size_t row) const { return rows_at.empty() ? row + 1 : rows_at[row]; }
};

/// What stands between the columns of a line; a space where they have any number of these.
char separator_of(const std::string& line) {
  for (const char separator : {',', ';', '\t'}) {
    bool inside_quotes = false;
    for (const char c : line) {
      if (c == '"') inside_quotes = !inside_quotes;
      if (c == separator && !inside_quotes) return separator;
    }
  }
  return ' ';
}

/// Separators inside double quotes are part of a word.
std::vector<std::string> words_of(const std::string& line, char separator) {
  std::vector<std::string> words(1);
  bool inside_quotes = false;
  for (const char c : line) {
    if (c == '"')
      inside_quotes = !inside_quotes;
    else if (!inside_quotes && (c == separator || (separator == ' ' && c == '\t')))
      words.emplace_back();
    else if (c != ' ' && c != '\t')
      words.back() += c;
  }
  if (separator == ' ') std::erase(words, "");
  return words;
}

/// With a point or, where commas separate no columns, a comma before its decimals.
std::optional<double> number_in(std::string word, char separator) {
  if (separator != ',') std::replace(word.begin(), word.end(), ',', '.');
  return to_number(word);
}

/// The names of a table whose first line that is no comment has numbers alone: those of the last comment before it.
std::vector<std::string> names_in_comment(const fs::path& path, size_t number, size_t columns, char separator,
                                          const std::string& comment) {
  const size_t begin = comment.find_first_not_of("# \t");
  if (begin != std::string::npos) {
    const std::string names = comment.substr(begin);
    for (const char between : {separator, separator_of(names)})
      if (std::vector<std::string> words = words_of(names, between); words.size() == columns) return words;
  }
  throw InputError(fmt::format("{}: line {} has numbers alone; expected a line of {} names before it, as x, y, z",
                               path.string(), number, columns));
}

/// Blank lines and those that begin with # hold nothing, but for a line of names that begins with #.
Table read_csv(const fs::path& path) {
  const std::string bytes = read_whole(path);
  const auto lines = static_cast<size_t>(std::count(bytes.begin(), bytes.end(), '\n'));
  if (lines > kMost + 1) fail_for_count(path.string(), lines - 1);
  Table table{{}, {}, "line", {}, {}};
  size_t number = 0, at = 0;
  char separator = ',';
  std::string comment;
  while (at < bytes.size()) {
    const size_t end = std::min(bytes.find('\n', at), bytes.size());
    std::string line = bytes.substr(at, end - at);
    at = end + 1;
    ++number;
    if (number == 1 && line.starts_with("\xef\xbb\xbf")) line.erase(0, 3);
    if (line.ends_with('\r')) line.pop_back();
    const size_t begin = line.find_first_not_of(" \t");
    if (begin == std::string::npos) continue;
    if (line[begin] == '#') {
      comment = line.substr(begin);
      continue;
    }
    if (table.columns.empty()) {
      separator = separator_of(line);
      table.columns = words_of(line, separator);
      table.first_text.resize(table.columns.size());
      const auto is_number = [&](const std::string& word) { return number_in(word, separator).has_value(); };
      if (!std::all_of(table.columns.begin(), table.columns.end(), is_number)) continue;
      table.columns = names_in_comment(path, number, table.columns.size(), separator, comment);
    }
    const std::vector<std::string> words = words_of(line, separator);
    if (words.size() != table.columns.size())
      throw InputError(fmt::format("{}: line {} has {} columns; expected {}, as its first line names them",
                                   path.string(), number, words.size(), table.columns.size()));
    for (size_t c = 0; c < words.size(); ++c) {
      const std::optional<double> value = number_in(words[c], separator);
      if (!value && !table.first_text[c])
        table.first_text[c] = {"'" + words[c].substr(0, 30) + "'", table.rows_at.size()};
      table.values.push_back(value.value_or(std::numeric_limits<double>::quiet_NaN()));
    }
    table.rows_at.push_back(number);
  }
  return table;
}

Table read_points(const fs::path& path) {
  PlyPoints points = read_ply_points(path, kMost);
  std::vector<std::optional<Text>> no_text(points.names.size());
  return {std::move(points.names), std::move(points.values), "point", {}, std::move(no_text)};
}

/// "P[x]", "P.x" and "P_x" are px.
std::string plain(std::string_view name) {
  std::string text;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c))) text += c;
  return lower(text);
}

/// Columns of a table by what they mean.
class Columns {
 public:
  Columns(const fs::path& path, const Table& table) : path_(path), table_(table) {
    for (const std::string& name : table.columns) names_.push_back(plain(name));
    position_ = vector({"", "p", "position", "pos", "t", "translate", "location"}, 3);
    for (int i = 0; i < 12; ++i)
      if (const int place = find(fmt::format("m{}{}", i / 4, i % 4)); place >= 0) matrix_.push_back(place);
    if (!matrix_.empty() && matrix_.size() < 12) fail("some of m00 .. m23", "all twelve: three rows of a matrix");
    if (matrix_.empty() && position_.empty()) fail("no place", "x, y, z, or m00 .. m23");
    if (const auto n = whole_vector({"n", "normal"}), up = whole_vector({"up"}); !n.empty() && !up.empty())
      n_ = n, up_ = up;
    orient_ = vector({"orient", "orientation", "rot", "rotation", "quaternion", "quat"}, 4);
    if (orient_.empty()) orient_ = all_parts_of("q", "xyzw");
    scales_ = vector({"scale"}, 3);
    if (scales_.empty()) scales_ = all_parts_of("s", "xyz");
    if (matrix_.empty() && orient_.empty() && n_.empty()) find_angles();
    scale_ = find("scale");
    pscale_ = find("pscale");
    density_ = find("density");
    tint_ = vector({"tint"}, 3);
    if (const int grey = find("tint"); tint_.empty() && grey >= 0) tint_ = {grey, grey, grey};
    time_offset_ = find("timeoffset");
  }

  void add_row(size_t row, InstanceList& list) const {
    const double* const values = table_.values.data() + row * table_.columns.size();
    const auto at = [&](int place) {
      const double value = values[place];
      if (const auto& text = table_.first_text[static_cast<size_t>(place)]; text && text->row == row)
        throw InputError(fmt::format("{}: {} {}, column '{}': {} is no number", path_.string(), table_.row_name,
                                     table_.row_number(row), table_.columns[static_cast<size_t>(place)], text->word));
      if (!std::isfinite(value)) fail_in(row, table_.columns[static_cast<size_t>(place)], value, "a finite number");
      return value;
    };
    dmat4 m(1);
    if (!matrix_.empty()) {
      for (int i = 0; i < 12; ++i) m[i % 4][i / 4] = at(matrix_[static_cast<size_t>(i)]);
    } else {
      for (const int place : angles_)
        if (const double angle = at(place); angle != 0)
          fail_in(row, table_.columns[static_cast<size_t>(place)], angle,
                  "0, as programs differ in how angles turn, or a quaternion, orient_x .. orient_w, or m00 .. m23");
      dmat3 rotation(1);
      if (orient_.empty() && !n_.empty()) {
        const auto direction = [&](const std::vector<int>& places) {
          return dvec3(at(places[0]), at(places[1]), at(places[2]));
        };
        const dvec3 z = direction(n_), x = glm::cross(direction(up_), z);
        if (!(glm::length(x) > 1e-12 * glm::length(z)))
          fail_in(row, table_.columns[static_cast<size_t>(n_[0])], z.x, "N above 0 and across up");
        rotation[0] = glm::normalize(x);
        rotation[2] = glm::normalize(z);
        rotation[1] = glm::cross(rotation[2], rotation[0]);
      }
      if (!orient_.empty()) {
        glm::dvec4 q;
        for (int i = 0; i < 4; ++i) q[i] = at(orient_[static_cast<size_t>(i)]);
        const double length = glm::length(q);
        if (!(length > 1e-12)) fail_in(row, table_.columns[static_cast<size_t>(orient_[0])], 0, "a quaternion above 0");
        q /= length;
        rotation = dmat3(1 - 2 * (q.y * q.y + q.z * q.z), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y),
                         2 * (q.x * q.y - q.w * q.z), 1 - 2 * (q.x * q.x + q.z * q.z), 2 * (q.y * q.z + q.w * q.x),
                         2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x), 1 - 2 * (q.x * q.x + q.y * q.y));
      }
      const double uniform = (scale_ >= 0 ? at(scale_) : 1) * (pscale_ >= 0 ? at(pscale_) : 1);
      for (int a = 0; a < 3; ++a) {
        const double own = scales_.empty() ? 1 : at(scales_[static_cast<size_t>(a)]);
        m[a] = glm::dvec4(rotation[a] * (uniform * own), 0);
        m[3][a] = at(position_[static_cast<size_t>(a)]);
      }
    }
    if (const std::string wrong = what_forbids_transform(m); !wrong.empty())
      throw InputError(fmt::format("{}: {} {}: its matrix is {}; expected an invertible one, scales other than 0",
                                   path_.string(), table_.row_name, table_.row_number(row), wrong));
    list.matrices.push_back(m);
    const auto factor = [&](int place) {
      const double value = at(place);
      if (value < 0) fail_in(row, table_.columns[static_cast<size_t>(place)], value, "at least 0");
      return value;
    };
    if (density_ >= 0) list.densities.push_back(factor(density_));
    if (!tint_.empty()) list.tints.emplace_back(factor(tint_[0]), factor(tint_[1]), factor(tint_[2]));
    if (time_offset_ >= 0) list.time_offsets.push_back(at(time_offset_));
  }

 private:
  [[noreturn]] void fail(const std::string& found, const std::string& expected) const {
    throw InputError(fmt::format("{}: its columns name {}; expected {}; it has {}", path_.string(), found, expected,
                                 join(table_.columns)));
  }
  [[noreturn]] void fail_in(size_t row, const std::string& column, double found, const std::string& expected) const {
    throw InputError(fmt::format("{}: {} {}, '{}': {}; expected {}", path_.string(), table_.row_name,
                                 table_.row_number(row), column, found, expected));
  }
  int find(const std::string& name) const {
    const auto found = std::find(names_.begin(), names_.end(), name);
    return found == names_.end() ? -1 : static_cast<int>(found - names_.begin());
  }
  /// The columns of a vector of this name that are there.
  std::vector<int> parts_of(const std::string& name, std::string_view ends) const {
    std::vector<int> places;
    for (const char end : ends)
      if (const int place = find(name + end); place >= 0) places.push_back(place);
    return places;
  }
  /// The same where all are there, else none.
  std::vector<int> all_parts_of(const std::string& name, std::string_view ends) const {
    std::vector<int> places = parts_of(name, ends);
    return places.size() == ends.size() ? places : std::vector<int>();
  }
  void find_angles() {
    for (const char* name : {"r", "rotate", "euler", "angle"})
      if (angles_.empty()) angles_ = all_parts_of(name, "xyz");
    for (const char* name : {"yaw", "pitch", "roll"})
      if (const int place = find(name); place >= 0) angles_.push_back(place);
  }
  /// The columns of a vector under the first of its names that is there: x, y, z, w, or r, g, b, or 0, 1, 2, 3.
  std::vector<int> vector(std::initializer_list<const char*> names, size_t length) const {
    for (const std::string name : names)
      for (const std::string_view ends : {"xyzw", "rgba", "0123"}) {
        if (name.empty() && ends != "xyzw") continue;
        std::vector<int> places = parts_of(name, ends.substr(0, length));
        if (places.size() == length) return places;
        if (!places.empty() && !name.empty())
          fail(fmt::format("{} parts of '{}'", places.size(), name),
               fmt::format("{}: {}", length, length == 4 ? "a quaternion, x, y, z, w" : "one for each axis"));
      }
    return {};
  }
  /// The same of one for each axis, where columns as "nx" or "n0" alone mean something else.
  std::vector<int> whole_vector(std::initializer_list<const char*> names) const {
    for (const std::string name : names)
      for (const std::string_view ends : {"xyz", "012"})
        if (std::vector<int> places = parts_of(name, ends); places.size() == 3) return places;
    return {};
  }

  const fs::path& path_;
  const Table& table_;
  std::vector<std::string> names_;
  std::vector<int> position_, matrix_, orient_, n_, up_, scales_, angles_, tint_;
  int scale_ = -1, pscale_ = -1, density_ = -1, time_offset_ = -1;
};

InstanceList read_places(const fs::path& path) {
  const std::string kind = plain(path.extension().string());
  if (kind != "csv" && kind != "ply")
    throw InputError(
        fmt::format("{}: of the kind '{}'; expected .csv or .ply", path.string(), path.extension().string()));
  const Table table = kind == "csv" ? read_csv(path) : read_points(path);
  const Columns columns(path, table);
  InstanceList list;
  for (size_t row = 0; row < table.rows(); ++row) columns.add_row(row, list);
  return list;
}

}  // namespace

std::string check_places(const std::string& name, const InstanceList& list) {
  const size_t count = list.matrices.size();
  if (count == 0) throw InputError(fmt::format("{}: has no matrices; expected one for each place", name));
  for (const auto& [what, have] : {std::pair("densities", list.densities.size()),
                                   {"tints", list.tints.size()},
                                   {"time_offsets", list.time_offsets.size()}})
    if (have > 0 && have != count)
      throw InputError(
          fmt::format("{}.{}: {} rows, expected {}, one for each of its matrices", name, what, have, count));
  for (size_t i = 0; i < list.time_offsets.size(); ++i)
    if (!std::isfinite(list.time_offsets[i]))
      throw InputError(
          fmt::format("{}.time_offsets: {} in row {}; expected a finite number", name, list.time_offsets[i], i));
  const auto at_least_0 = [](double v) { return v >= 0 && std::isfinite(v); };
  uint64_t hash = count;
  const auto add = [&](double v) { hash = mix64(hash ^ std::bit_cast<uint64_t>(v)); };
  for (size_t i = 0; i < count; ++i) {
    if (!list.densities.empty() && !at_least_0(list.densities[i]))
      throw InputError(fmt::format("{}.densities: {} in row {}; expected at least 0", name, list.densities[i], i));
    for (int c = 0; c < 3 && !list.tints.empty(); ++c)
      if (!at_least_0(list.tints[i][c]))
        throw InputError(fmt::format("{}.tints: {} in row {}; expected at least 0", name, list.tints[i][c], i));
    for (int a = 0; a < 16; ++a) add(list.matrices[i][a / 4][a % 4]);
    if (!list.densities.empty()) add(list.densities[i]);
    for (int c = 0; c < 3 && !list.tints.empty(); ++c) add(list.tints[i][c]);
    if (!list.time_offsets.empty()) add(list.time_offsets[i]);
  }
  return fmt::format("{:016x}", hash);
}

InstanceList places_of(const InstanceSettings& settings, const std::string& name) {
  InstanceList list = settings.arrays ? *settings.arrays : InstanceList{settings.matrices, {}, {}, {}};
  if (!settings.file.empty()) list = read_places(settings.file);
  const size_t count = list.matrices.size();
  if (count == 0)
    throw InputError(fmt::format("{}: holds no places; expected at least one",
                                 settings.file.empty() ? name : settings.file.string()));
  if (count > kMost) fail_for_count(name, count);
  list.densities.resize(count, 1.0);
  list.tints.resize(count, dvec3(1));
  if (settings.time_offset != 0) list.time_offsets.resize(count, 0.0);
  for (double& offset : list.time_offsets) offset += settings.time_offset;
  for (size_t i = 0; i < count; ++i) {
    list.matrices[i] = settings.object_to_world * list.matrices[i];
    list.densities[i] *= settings.density;
    list.tints[i] *= settings.tint;
  }
  return list;
}

}  // namespace brume
