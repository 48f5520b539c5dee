#include "render/scene/scene_outline.h"

#include <sstream>

#include "base/error.h"
#include "base/toml_text.h"
#include "render/scene/toml_table.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using Type = SceneKey::Type;

/// Collects the keys of a table whose values have been read.
class Collector {
 public:
  Collector(const toml::value* table, SceneTable& into) : table_(table), into_(into) {}

  void operator()(const Field& field, const bool& v) { add(field, Type::kSwitch, v); }
  void operator()(const Field& field, const int& v) { add(field, Type::kInteger, int64_t{v}); }
  void operator()(const Field& field, const int64_t& v) { add(field, Type::kInteger, v); }
  void operator()(const Field& field, const double& v) { add(field, Type::kNumber, v); }
  void operator()(const Field& field, const std::string& v) {
    add(field, field.choices.empty() ? Type::kText : Type::kChoice, v);
  }
  void operator()(const Field& field, const dvec2& v) { add(field, Type::kNumbers, std::vector{v.x, v.y}); }
  void operator()(const Field& field, const dvec3& v) {
    add(field, field.lowest >= 0 ? Type::kColour : Type::kVector, std::vector{v.x, v.y, v.z});
  }
  void operator()(const Field& field, const std::vector<double>& v) { add(field, Type::kNumbers, v); }
  template <class Table>  // matrices, rows of numbers, names of files: as they are written
  void operator()(const Field& field, const Table&) {
    const bool file = std::is_same_v<Table, fs::path>;
    std::string text;
    if (table_ && table_->contains(field.key)) {
      const toml::value& value = table_->at(field.key);
      text = file ? toml::get<std::string>(value) : toml_text(value);
    }
    add(field, file ? Type::kFile : Type::kTable, text);
  }

 private:
  void add(const Field& field, Type type, SceneKey::Value value) {
    into_.keys.push_back({field, type, std::move(value)});
  }
  const toml::value* table_;
  SceneTable& into_;
};

std::vector<SceneTable> outline(const toml::value& root, const fs::path& path, const SceneArrays& arrays) {
  std::vector<SceneTable> tables;
  int frame = 0;
  const auto no_arrays = [](TomlTable&) {};
  const auto table = [&](const std::string& name, const std::string& where, const toml::value* from, auto settings,
                         const auto& begin) {
    if (from) {
      TomlTable parser(*from, where, path.parent_path(), frame);
      begin(parser);
      describe(parser, settings);
      parser.reject_unknown();
    }
    SceneTable& entry = tables.emplace_back();
    entry.path = name;
    Collector collector(from, entry);
    describe(collector, settings);
    return settings;
  };
  const auto section = [&](const char* name, auto settings) {
    return table(name, fmt::format("[{}]", name), root.contains(name) ? &root.at(name) : nullptr, settings, no_arrays);
  };
  const auto list = [&](const char* name, auto settings, const auto& begin) {
    if (!root.contains(name)) return;
    const toml::value& entries = root.at(name);
    if (!entries.is_array())
      fail_at(fmt::format("'{}' is {}", name, toml_type_name(entries)), entries, fmt::format("expected [[{}]]", name));
    for (size_t i = 0; i < entries.as_array().size(); ++i)
      table(fmt::format("{}.{}", name, i), fmt::format("[[{}]]", name), &entries.as_array()[i], settings,
            [&](TomlTable& parser) { begin(parser, i); });
  };
  frame = section("render", RenderSettings()).frame;
  section("camera", CameraSettings());
  section("film", FilmSettings());
  section("environment", EnvironmentSettings());
  list("volumes", VolumeSettings(), [&](TomlTable& parser, size_t i) {
    ArrayPlacement placement;
    if (arrays.volumes.contains(i)) describe(parser, placement);
  });
  list("instances", InstanceSettings(), [](const auto&...) {});
  list("lights", LightSettings(), [](const auto&...) {});
  list("surfaces", SurfaceSettings(), [&](TomlTable& parser, size_t i) {
    if (arrays.meshes.contains(i)) parser.provides("file");
  });
  return tables;
}

toml::value parsed(const std::string& text, const fs::path& path, std::span<const std::string> assignments) {
  std::istringstream stream(text);
  toml::value root = parse_toml(stream, path.string());
  for (const std::string& assignment : assignments) apply_assignment(root, assignment);
  return root;
}

/// A text whose lines can be found again after pieces of it were replaced from the end on.
class TextEditor {
 public:
  explicit TextEditor(std::string text) : text_(std::move(text)) {}

  void replace(const toml::value& value, const std::string& by) {
    const TomlPlace at = toml_place(value);
    edits_.push_back({offset(at.line) + at.column - 1, at.length, by});
  }
  /// A line after the one in which a value begins, the header of a table.
  void insert_below(const toml::value& header, const std::string& line) {
    edits_.push_back({offset(toml_place(header).line + 1), 0, line + "\n"});
  }
  void append(const std::string& text) { end_ += text; }

  std::string edited() {
    std::stable_sort(edits_.begin(), edits_.end(), [](const Edit& a, const Edit& b) { return a.at > b.at; });
    for (const Edit& edit : edits_) text_.replace(edit.at, edit.length, edit.text);
    if (!text_.empty() && text_.back() != '\n') text_ += '\n';
    return text_ + end_;
  }

 private:
  struct Edit {
    size_t at, length;
    std::string text;
  };
  size_t offset(size_t line) const {
    size_t at = 0;
    for (size_t i = 1; i < line && at < text_.size(); ++i) {
      const size_t end = text_.find('\n', at);
      at = end == std::string::npos ? text_.size() : end + 1;
    }
    return at;
  }
  std::string text_, end_;
  std::vector<Edit> edits_;
};

std::string lines_of(const std::string& header, const toml::value& table) {
  std::string text = "\n" + header + "\n";
  for (const auto& [key, value] : table.as_table()) text += fmt::format("{} = {}\n", toml_key(key), toml_text(value));
  return text;
}

/// A scene as text of its own.
std::string written_anew(const toml::value& scene) {
  std::string text, tables;
  for (const auto& [name, value] : scene.as_table())
    if (value.is_table())
      tables += lines_of("[" + name + "]", value);
    else if (value.is_array() && !value.as_array().empty())
      for (const toml::value& entry : value.as_array()) tables += lines_of("[[" + name + "]]", entry);
    else
      text += fmt::format("{} = {}\n", toml_key(name), toml_text(value));
  return text + tables;
}

/// The differences between two tables of a scene, written into the text of the first.
void edit_table(TextEditor& editor, const toml::value& before, const toml::value& after) {
  for (const auto& [key, value] : after.as_table()) {
    const std::string text = toml_text(value);
    if (!before.contains(key))
      editor.insert_below(before, fmt::format("{} = {}", toml_key(key), text));
    else if (before.at(key) != value)
      editor.replace(before.at(key), text);
  }
}

std::string edited(const std::string& text, const toml::value& before, const toml::value& after) {
  TextEditor editor(text);
  for (const auto& [name, value] : after.as_table()) {
    if (value.is_table()) {
      if (before.contains(name))
        edit_table(editor, before.at(name), value);
      else
        editor.append(lines_of("[" + name + "]", value));
    } else if (value.is_array()) {
      const size_t own = before.contains(name) ? before.at(name).as_array().size() : 0;
      for (size_t i = 0; i < value.as_array().size(); ++i)
        if (i < own)
          edit_table(editor, before.at(name).as_array()[i], value.as_array()[i]);
        else
          editor.append(lines_of("[[" + name + "]]", value.as_array()[i]));
    } else if (before.contains(name) && before.at(name) != value) {
      editor.replace(before.at(name), toml_text(value));
    }
  }
  return editor.edited();
}

/// The text of a scene that another text stands for, its comments and order kept where they can be.
std::string text_for(const toml::value& wanted, const std::string& text, const fs::path& path) {
  // What a text of unusual form makes of the edits is looked at; where it means something else, all is written anew.
  try {
    std::string result = edited(text, parsed(text, path, {}), wanted);
    if (parsed(result, path, {}) == wanted) return result;
  } catch (const std::exception&) {
  }
  return written_anew(wanted);
}

/// What makes the relative names of files absolute.
std::vector<std::string> absolute_files(const std::vector<SceneTable>& tables, const fs::path& path) {
  std::vector<std::string> assignments;
  for (const SceneTable& table : tables)
    for (const SceneKey& key : table.keys)
      if (const auto* const file = std::get_if<std::string>(&key.value);
          key.type == Type::kFile && !file->empty() && fs::path(*file).is_relative())
        assignments.push_back(
            fmt::format("{}.{}={}", table.path, key.field.key,
                        toml_string(fs::absolute(path.parent_path() / *file).lexically_normal().string())));
  return assignments;
}

}  // namespace

const SceneKey* SceneTable::find(std::string_view key) const {
  const auto found = std::find_if(keys.begin(), keys.end(), [&](const SceneKey& k) { return key == k.field.key; });
  return found == keys.end() ? nullptr : &*found;
}

std::vector<SceneTable> outline_scene(const std::string& text, const fs::path& path,
                                      std::span<const std::string> assignments, const SceneArrays& arrays) {
  return outline(parsed(text, path, assignments), path, arrays);
}

std::set<std::string> assigned_keys(std::span<const std::string> assignments) {
  toml::value root = toml::table{{"volumes", toml::array{toml::table()}}, {"lights", toml::array{toml::table()}}};
  for (const std::string& assignment : assignments) apply_assignment(root, assignment);
  std::set<std::string> keys;
  const auto add = [&](const std::string& table, const toml::value& value) {
    if (value.is_table())
      for (const auto& entry : value.as_table()) keys.insert(table + "." + entry.first);
  };
  for (const auto& [name, value] : root.as_table()) {
    add(name, value);
    if (value.is_array())
      for (size_t i = 0; i < value.as_array().size(); ++i) add(fmt::format("{}.{}", name, i), value.as_array()[i]);
  }
  return keys;
}

std::string edited_scene(const std::string& text, const fs::path& path, std::span<const std::string> assignments,
                         const SceneArrays& arrays) {
  toml::value wanted = parsed(text, path, assignments);
  for (const std::string& assignment : absolute_files(outline(wanted, path, arrays), path))
    apply_assignment(wanted, assignment);
  return text_for(wanted, text, path);
}

std::string moved_scene(const std::string& text, const fs::path& path, std::span<const std::string> assignments,
                        const fs::path& from) {
  toml::value wanted = parsed(text, path, assignments);
  const std::set<std::string> keys = assigned_keys(assignments);
  std::error_code error;
  if (!fs::equivalent(fs::absolute(path).parent_path(), fs::absolute(from).parent_path(), error))
    for (const std::string& assignment : absolute_files(outline(wanted, path, {}), from))
      if (keys.contains(assignment.substr(0, assignment.find('=')))) apply_assignment(wanted, assignment);
  return text_for(wanted, text, path);
}

}  // namespace brume
