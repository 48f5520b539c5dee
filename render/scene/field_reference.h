#pragma once
#include <fmt/format.h>

#include <filesystem>
#include <string>
#include <vector>

#include "base/text.h"
#include "render/scene/scene_fields.h"

namespace brume {

/// Writes a reference page from the declarations that a file's tables are parsed by.
class FieldReference {
 public:
  template <class T>
  void operator()(const Field& field, const T& value) {
    const std::string limits = field.choices.empty() ? range(field) : join(field.choices, " \\| ");
    text += fmt::format("| `{}` | {} | {} | {} | {} |\n", field.key, field.required ? "required" : show(value),
                        field.unit, limits, field.help);
  }
  template <class Settings>
  void table(const char* heading, const char* about, Settings settings) {
    begin(heading, about);
    describe(*this, settings);
  }
  void begin(const char* heading, const char* about) {
    text += fmt::format("\n## `{}`\n\n{}\n\n| key | default | unit | range | meaning |\n|---|---|---|---|---|\n",
                        heading, about);
  }
  std::string text;

 private:
  static std::string range(const Field& field) {
    if (field.lowest == -kInfinity && field.highest == kInfinity) return "";
    if (field.highest == kInfinity) return fmt::format("at least {}", field.lowest);
    return fmt::format("{} .. {}", field.lowest, field.highest);
  }
  static std::string show(const dvec3& v) { return fmt::format("`[{}, {}, {}]`", v.x, v.y, v.z); }
  static std::string show(const dmat4& m) { return m == dmat4(1) ? "identity" : "all zero"; }
  static std::string show(const dvec2& v) { return fmt::format("`[{}, {}]`", v.x, v.y); }
  static std::string show(const std::vector<std::vector<double>>&) { return "none"; }
  static std::string show(const std::vector<dmat4>&) { return "none"; }
  static std::string show(const VolumeTime&) { return "none"; }
  static std::string show(const VolumeDetail&) { return "none"; }
  static std::string show(const std::filesystem::path&) { return "none"; }
  static std::string show(const std::string& s) { return "`\"" + s + "\"`"; }
  static std::string show(const std::vector<int>& list) {
    std::vector<std::string> texts;
    for (const int value : list) texts.push_back(std::to_string(value));
    return list.empty() ? "none" : "`[" + join(texts) + "]`";
  }
  static std::string show(const std::vector<std::string>&) { return "none"; }
  static std::string show(const std::vector<double>&) { return "none"; }
  static std::string show(const std::vector<std::filesystem::path>&) { return "none"; }
  template <class T>
  static std::string show(const T& value) {
    return fmt::format("`{}`", value);
  }
};

}  // namespace brume
