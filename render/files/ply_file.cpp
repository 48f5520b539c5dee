#include "render/files/ply_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/text.h"
#include "render/files/file_numbers.h"
#include "render/files/polygon_mesh.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

enum class Type { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

struct Property {
  std::string name;
  Type type = Type::kFloat32;
  bool list = false;
  Type count_type = Type::kUint8;
};

struct Element {
  std::string name;
  size_t count = 0;
  std::vector<Property> properties;

  /// The place of the property of one of these names; -1: none.
  int find(std::initializer_list<std::string_view> names, bool list = false) const {
    for (const std::string_view wanted : names)
      for (size_t i = 0; i < properties.size(); ++i)
        if (properties[i].name == wanted && properties[i].list == list) return static_cast<int>(i);
    return -1;
  }
};

class PlyReader {
 public:
  explicit PlyReader(const fs::path& path) : path_(path), bytes_(read_whole(path)) {}

  TriangleMesh read() {
    read_header();
    find_places();
    for (const Element& element : elements_) {
      element_ = &element;
      if (element.name == "vertex")
        read_vertices(element);
      else if (element.name == "face")
        read_faces(element);
      else if (element.name == "tristrips")
        read_strips(element);
      else
        read_rows(element, [](const Row&) {});
    }
    if (mesh_.faces() == 0) {
      std::vector<std::string> there;
      for (const Element& element : elements_) there.push_back(fmt::format("{} of '{}'", element.count, element.name));
      fail(fmt::format("holds no faces; it has {}", there.empty() ? "no elements" : join(there)));
    }
    return mesh_.triangles(path_, "face");
  }

  PlyPoints points(size_t most) {
    read_header();
    PlyPoints points;
    for (const Element& element : elements_) {
      element_ = &element;
      const bool vertices = element.name == "vertex";
      if (vertices && element.count > most) fail(fmt::format("{} points; expected at most {}", element.count, most));
      const auto& properties = element.properties;
      read_rows(element, [&](const Row& row) {
        for (size_t p = 0; vertices && p < properties.size(); ++p)
          if (!properties[p].list) points.values.push_back(row.values[p]);
      });
      if (!vertices) continue;
      for (const Property& property : properties)
        if (!property.list) points.names.push_back(property.name);
      return points;
    }
    fail("has no element 'vertex'; expected points");
  }

 private:
  /// One entry of an element: a number for each property, and the entries of its lists.
  struct Row {
    size_t index;
    std::vector<double> values;
    std::vector<std::vector<double>> lists;
  };

  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(fmt::format("{}: {}", path_.string(), what));
  }
  [[noreturn]] void fail_in_row(const std::string& what) const {
    fail(fmt::format("{} in {} {} of {}", what, element_->name, row_ + 1, element_->count));
  }

  std::string header_line() {
    const size_t end = bytes_.find(line_end_, at_);
    if (end == std::string::npos) fail("truncated: the PLY header has no end");
    std::string line = bytes_.substr(at_, end - at_);
    at_ = end + line_end_.size();
    while (line.ends_with('\r') || line.ends_with(' ')) line.pop_back();
    return line;
  }

  void read_header() {
    // The first line shows how all of the header end: what follows the last one may be pixels of any value.
    const size_t first = bytes_.find_first_of("\r\n");
    line_end_ = first == std::string::npos || bytes_[first] == '\n' ? "\n"
                : bytes_.compare(first, 2, "\r\n") == 0             ? "\r\n"
                                                                    : "\r";
    header_line();
    while (true) {
      const std::string line = header_line();
      std::vector<std::string> words = split(line, ' ');
      std::erase(words, "");
      const std::string word = words.empty() ? "" : words[0];
      const auto at = [&](size_t i) { return i < words.size() ? words[i] : std::string(); };
      if (word == "end_header") break;
      if (word == "format") {
        if (at(1) == "ascii")
          ascii_ = true;
        else if (at(1) == "binary_big_endian")
          swap_ = std::endian::native == std::endian::little;
        else if (at(1) == "binary_little_endian")
          swap_ = std::endian::native == std::endian::big;
        else
          fail(fmt::format("PLY format '{}'; expected ascii, binary_little_endian or binary_big_endian", at(1)));
      } else if (word == "element") {
        const std::optional<int64_t> count = to_whole_number(at(2));
        if (!count || *count < 0) fail(fmt::format("'{}'; expected an element with a name and a number", line));
        elements_.push_back({at(1), static_cast<size_t>(*count), {}});
      } else if (word == "property") {
        if (elements_.empty()) fail("a property before any element");
        Property property;
        property.list = at(1) == "list";
        if (property.list) property.count_type = type(at(2));
        property.type = type(at(property.list ? 3 : 1));
        property.name = at(property.list ? 4 : 2);
        elements_.back().properties.push_back(property);
      } else if (!word.empty() && word != "comment" && word != "obj_info") {
        fail(fmt::format("'{}' in its header; expected format, element, property, comment, obj_info or end_header",
                         line));
      }
    }
    for (const Element& element : elements_)
      if (element.count > 0 && element.properties.empty())
        fail(fmt::format("element '{}' has no properties; expected at least one", element.name));
  }

  Type type(const std::string& word) const {
    static const std::pair<const char*, Type> names[] = {
        {"char", Type::kInt8},      {"int8", Type::kInt8},       {"uchar", Type::kUint8},
        {"uint8", Type::kUint8},    {"short", Type::kInt16},     {"int16", Type::kInt16},
        {"ushort", Type::kUint16},  {"uint16", Type::kUint16},   {"int", Type::kInt32},
        {"int32", Type::kInt32},    {"uint", Type::kUint32},     {"uint32", Type::kUint32},
        {"float", Type::kFloat32},  {"float32", Type::kFloat32}, {"double", Type::kFloat64},
        {"float64", Type::kFloat64}};
    for (const auto& [name, known] : names)
      if (word == name) return known;
    fail(fmt::format("unknown PLY type '{}'", word));
  }

  template <class T>
  double binary() {
    if (bytes_.size() - at_ < sizeof(T)) fail_in_row("truncated: the file ends");
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    if (swap_) std::reverse(raw.begin(), raw.end());
    return static_cast<double>(std::bit_cast<T>(raw));
  }
  double number(Type type) {
    if (ascii_) {
      constexpr const char* kBlank = " \t\r\n\v\f";
      const size_t from = std::min(bytes_.find_first_not_of(kBlank, at_), bytes_.size());
      if (from == bytes_.size()) fail_in_row("truncated: the file ends");
      at_ = std::min(bytes_.find_first_of(kBlank, from), bytes_.size());
      const std::string_view word(bytes_.data() + from, at_ - from);
      const std::optional<double> value = to_number(word);
      if (!value) fail_in_row(fmt::format("damaged: '{}' is no number", word.substr(0, 30)));
      return *value;
    }
    switch (type) {
      case Type::kInt8:
        return binary<int8_t>();
      case Type::kUint8:
        return binary<uint8_t>();
      case Type::kInt16:
        return binary<int16_t>();
      case Type::kUint16:
        return binary<uint16_t>();
      case Type::kInt32:
        return binary<int32_t>();
      case Type::kUint32:
        return binary<uint32_t>();
      case Type::kFloat32:
        return binary<float>();
      default:
        return binary<double>();
    }
  }

  /// Calls use(row) for each entry of an element.
  template <class Use>
  void read_rows(const Element& element, const Use& use) {
    constexpr double kLongest = 1e8;
    Row row{0, std::vector<double>(element.properties.size()), {}};
    row.lists.resize(element.properties.size());
    for (row_ = 0; row_ < element.count; ++row_) {
      row.index = row_;
      for (size_t p = 0; p < element.properties.size(); ++p) {
        const Property& property = element.properties[p];
        if (!property.list) {
          row.values[p] = number(property.type);
          continue;
        }
        const double count = number(property.count_type);
        if (!(count >= 0 && count < kLongest && count == std::floor(count)))
          fail_in_row(fmt::format("damaged: a list of {} entries", count));
        row.lists[p].clear();
        for (double k = 0; k < count; ++k) row.lists[p].push_back(number(property.type));
      }
      use(row);
    }
  }

  /// What a vertex holds: places of its properties, -1 for what it has not.
  struct VertexPlaces {
    std::array<int, 3> position{-1, -1, -1}, normal{-1, -1, -1};
    std::array<int, 2> texcoord{-1, -1};
  };
  static bool has(std::span<const int> places) {
    return std::all_of(places.begin(), places.end(), [](int place) { return place >= 0; });
  }

  void find_places() {
    for (const Element& e : elements_) {
      if (e.name != "vertex") continue;
      places_.position = {e.find({"x"}), e.find({"y"}), e.find({"z"})};
      places_.normal = {e.find({"nx"}), e.find({"ny"}), e.find({"nz"})};
      places_.texcoord = {e.find({"u", "s", "texture_u", "texture_s"}), e.find({"v", "t", "texture_v", "texture_t"})};
      if (!has(places_.position)) fail("its vertices have no x, y, z");
    }
  }

  void read_vertices(const Element& element) {
    read_rows(element, [&](const Row& row) {
      const auto value = [&](int place) { return row.values[static_cast<size_t>(place)]; };
      const auto& [position, normal, texcoord] = places_;
      mesh_.positions.emplace_back(value(position[0]), value(position[1]), value(position[2]));
      if (has(normal)) mesh_.normals.emplace_back(value(normal[0]), value(normal[1]), value(normal[2]));
      if (has(texcoord)) mesh_.texcoords.emplace_back(value(texcoord[0]), value(texcoord[1]));
    });
  }

  PolygonMesh::Corner corner(double place) const {
    const bool possible = place >= 0 && place < std::numeric_limits<int>::max() && place == std::floor(place);
    const int vertex = possible ? static_cast<int>(place) : PolygonMesh::kNowhere;
    return {vertex, has(places_.texcoord) ? vertex : PolygonMesh::kNone,
            has(places_.normal) ? vertex : PolygonMesh::kNone};
  }

  void read_faces(const Element& element) {
    const int indices = element.find({"vertex_indices", "vertex_index"}, /*list=*/true);
    const int texcoords = element.find({"texcoord"}, /*list=*/true);
    if (element.count > 0 && indices < 0) {
      std::vector<std::string> there;
      for (const Property& property : element.properties) there.push_back(property.name);
      fail(fmt::format("its faces have no list vertex_indices; they have {}", join(there)));
    }
    read_rows(element, [&](const Row& row) {
      const std::vector<double>& places = row.lists[static_cast<size_t>(indices)];
      corners_.clear();
      for (const double place : places) corners_.push_back(corner(place));
      if (texcoords >= 0 && !has(places_.texcoord))
        if (const std::vector<double>& uv = row.lists[static_cast<size_t>(texcoords)]; uv.size() == 2 * places.size())
          for (size_t k = 0; k < corners_.size(); ++k) {
            corners_[k].texcoord = static_cast<int>(mesh_.texcoords.size());
            mesh_.texcoords.emplace_back(uv[2 * k], uv[2 * k + 1]);
          }
      mesh_.add_face(corners_, row.index + 1);
    });
  }

  /// Strips of triangles that each share an edge with the one before; -1 begins a new one.
  void read_strips(const Element& element) {
    const int indices = element.find({"vertex_indices", "vertex_index"}, /*list=*/true);
    if (element.count > 0 && indices < 0) fail("its tristrips have no list vertex_indices");
    read_rows(element, [&](const Row& row) {
      std::vector<double> strip;
      for (const double place : row.lists[static_cast<size_t>(indices)]) {
        if (place < 0) {
          strip.clear();
          continue;
        }
        strip.push_back(place);
        if (strip.size() < 3) continue;
        const size_t i = strip.size() - 3, odd = i % 2;
        corners_ = {corner(strip[i + odd]), corner(strip[i + 1 - odd]), corner(strip[i + 2])};
        // Two equal ones in a row go round a corner: no triangles of their own.
        if (strip[i] != strip[i + 1] && strip[i + 1] != strip[i + 2] && strip[i] != strip[i + 2])
          mesh_.add_face(corners_, row.index + 1);
      }
    });
  }

  fs::path path_;
  std::string bytes_, line_end_ = "\n";
  size_t at_ = 0, row_ = 0;
  bool ascii_ = false, swap_ = false;
  std::vector<Element> elements_;
  const Element* element_ = nullptr;  // that is read
  VertexPlaces places_;
  std::vector<PolygonMesh::Corner> corners_;
  PolygonMesh mesh_;
};

}  // namespace

TriangleMesh read_ply(const fs::path& path) {
  return PlyReader(path).read();
}

PlyPoints read_ply_points(const fs::path& path, size_t most) {
  return PlyReader(path).points(most);
}

}  // namespace brume
