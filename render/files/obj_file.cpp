#include "render/files/obj_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.h"
#include "render/files/file_numbers.h"
#include "render/files/polygon_mesh.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

class ObjReader {
 public:
  explicit ObjReader(const fs::path& path) : path_(path), text_(read_whole(path)) {
    if (text_.starts_with("\xEF\xBB\xBF")) at_ = 3;  // byte order mark
    if (text_.starts_with("\xFE\xFF") || text_.starts_with("\xFF\xFE"))
      fail("is UTF-16 text; expected an OBJ file in ASCII or UTF-8");
  }

  TriangleMesh read() {
    while (next_line()) {
      const std::string_view word = words_.empty() ? "" : words_[0];
      if (word == "v") {
        const auto p = numbers(3, 3);
        mesh_.positions.emplace_back(p[0], p[1], p[2]);
      } else if (word == "vt") {
        const auto p = numbers(1, 2);
        mesh_.texcoords.emplace_back(p[0], p[1]);
      } else if (word == "vn") {
        const auto p = numbers(3, 3);
        mesh_.normals.emplace_back(p[0], p[1], p[2]);
      } else if (word == "f" || word == "fo") {  // fo: its older name
        add_face();
      } else if (word == "surf") {
        ++surfaces_;
      }
    }
    if (mesh_.faces() == 0)
      fail(fmt::format(
          "holds no faces: no line of its {} begins with f; it has {} vertices{}", line_, mesh_.positions.size(),
          surfaces_ ? fmt::format(" and {} free-form surfaces, which brume does not read", surfaces_) : ""));
    return mesh_.triangles(path_, "line");
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(fmt::format("{}: {}", path_.string(), what));
  }
  [[noreturn]] void fail_in_line(const std::string& expected) const {
    constexpr size_t kShown = 60;
    std::string line;
    for (const std::string_view word : words_) line += (line.empty() ? "" : " ") + std::string(word);
    fail(fmt::format("line {}: '{}'; expected {}", begin_, line.substr(0, kShown), expected));
  }

  /// Splits the next line into words, with those that it goes on in. @return false at the end
  bool next_line() {
    words_.clear();
    if (at_ >= text_.size()) return false;
    begin_ = line_ + 1;
    bool goes_on = true;
    while (goes_on && at_ < text_.size()) {
      const size_t end = std::min(text_.find_first_of("\r\n", at_), text_.size());
      std::string_view line(text_.data() + at_, end - at_);
      at_ = end + (text_.compare(end, 2, "\r\n") == 0 ? 2 : 1);
      ++line_;
      while (!line.empty() && (line.back() == ' ' || line.back() == '\t')) line.remove_suffix(1);
      goes_on = line.ends_with('\\');
      if (goes_on) line.remove_suffix(1);
      goes_on = add_words(line) && goes_on;
    }
    return true;
  }

  /// @return false when a comment ended the line
  bool add_words(std::string_view line) {
    constexpr std::string_view kBlank = " \t\v\f";
    for (size_t from = 0; (from = line.find_first_not_of(kBlank, from)) != std::string_view::npos;) {
      if (line[from] == '#') return false;
      const size_t end = std::min(line.find_first_of(kBlank, from), line.size());
      words_.push_back(line.substr(from, end - from));
      from = end;
    }
    return true;
  }

  /// Numbers of the line; what is missing between `least` and 3 is 0.
  std::array<double, 3> numbers(size_t least, size_t most) const {
    std::array<double, 3> values{};
    for (size_t i = 0; i < most; ++i) {
      const std::optional<double> value = i + 1 < words_.size() ? to_number(words_[i + 1]) : std::nullopt;
      if (!value && (i < least || i + 1 < words_.size()))
        fail_in_line(least == 3 ? "three numbers" : "a number or more");
      values[i] = value.value_or(0.0);
    }
    return values;
  }

  void add_face() {
    corners_.clear();
    for (size_t i = 1; i < words_.size(); ++i) {
      const std::string_view word = words_[i];
      PolygonMesh::Corner corner{PolygonMesh::kNone};
      const std::pair<int*, size_t> parts[] = {{&corner.position, mesh_.positions.size()},
                                               {&corner.texcoord, mesh_.texcoords.size()},
                                               {&corner.normal, mesh_.normals.size()}};
      size_t from = 0;
      for (const auto& [target, count] : parts) {
        const size_t end = std::min(word.find('/', from), word.size());
        if (end > from) *target = place(word.substr(from, end - from), count);
        from = std::min(end + 1, word.size());
      }
      if (word.starts_with('/') || from < word.size()) fail_in_line("corners as v, v/vt, v//vn or v/vt/vn");
      corners_.push_back(corner);
    }
    mesh_.add_face(corners_, begin_);
  }

  /// A place in a list of which `count` entries are read. 0, which names none, lies out of range.
  int place(std::string_view word, size_t count) const {
    const std::optional<int64_t> number = to_whole_number(word);
    if (!number) fail_in_line("whole numbers as corners: v, v/vt, v//vn or v/vt/vn");
    const int64_t index = *number > 0 ? *number - 1 : *number < 0 ? static_cast<int64_t>(count) + *number : -1;
    const bool possible = index >= 0 && index < std::numeric_limits<int>::max();
    return possible ? static_cast<int>(index) : PolygonMesh::kNowhere;
  }

  fs::path path_;
  std::string text_;
  size_t at_ = 0, line_ = 0, begin_ = 0;  // of the text; the lines read, and where the present one begins
  size_t surfaces_ = 0;
  std::vector<std::string_view> words_;
  std::vector<PolygonMesh::Corner> corners_;
  PolygonMesh mesh_;
};

}  // namespace

TriangleMesh read_obj(const fs::path& path) {
  return ObjReader(path).read();
}

}  // namespace brume
