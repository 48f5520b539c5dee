#include "render/scene/scene_reference.h"

#include <fmt/format.h>

#include "base/text.h"
#include "render/scene/scene_fields.h"

namespace brume {
namespace {

/// Writes the reference page from the same declarations.
class Reference {
 public:
  template <class T>
  void operator()(const Field& field, const T& value) {
    const std::string limits = field.choices.empty() ? range(field) : join(field.choices, " \\| ");
    text += fmt::format("| `{}` | {} | {} | {} | {} |\n", field.key, field.required ? "required" : show(value),
                        field.unit, limits, field.help);
  }
  template <class Settings>
  void table(const char* heading, const char* about, Settings settings) {
    text += fmt::format("\n## `{}`\n\n{}\n\n| key | default | unit | range | meaning |\n|---|---|---|---|---|\n",
                        heading, about);
    describe(*this, settings);
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
  static std::string show(const std::vector<double>&) { return "none"; }
  static std::string show(const std::vector<std::vector<double>>&) { return "none"; }
  static std::string show(const std::filesystem::path&) { return "none"; }
  static std::string show(const std::string& s) { return "`\"" + s + "\"`"; }
  template <class T>
  static std::string show(const T& value) {
    return fmt::format("`{}`", value);
  }
};

}  // namespace

std::string scene_reference() {
  Reference reference;
  reference.text =
      "# Scenes\n\n"
      "A scene is a TOML file. Paths in it start at its own folder. Unknown keys are errors. Any key can be set from "
      "the\n"
      "command line: `-D camera.fov=30`, `-D volumes.0.sigma_t=5`; paths given so start at the scene's folder too. "
      "Colours are linear Rec. 709, `[r, g, b]` or one "
      "grey\n"
      "number. Lengths are in scene units, whichever the volumes use.\n\n"
      "This page is written by `brume docs scene`; a test keeps it in step with the parser.\n";
  reference.table("[camera]", "Box filter of one pixel, row 0 on top.", CameraSettings{});
  reference.table("[film]", "The picture.", FilmSettings{});
  reference.table("[render]", "The estimator. No setting here but max_events changes the expected picture.",
                  RenderSettings{});
  reference.table("[environment]", "Light from infinitely far away.", EnvironmentSettings{});
  reference.table("[[volumes]]",
                  "A fog volume and its coefficients: sigma_t(x) = sigma_t * density(x), sigma_s = albedo * sigma_t. "
                  "Several may overlap. `file` is required where shape is grid.",
                  VolumeSettings{});
  reference.table("[[lights]]", "Lights of finite size or parallel light.", LightSettings{});
  reference.table("[[surfaces]]", "Solid things.", SurfaceSettings{});
  return reference.text;
}

}  // namespace brume
