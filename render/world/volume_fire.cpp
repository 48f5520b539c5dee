#include "render/world/volume_fire.h"

#include <fmt/format.h>

#include <cctype>

#include "base/error.h"
#include "volume/emission.h"

namespace brume {
namespace {

constexpr double kHottest = 2200;     // [K] where a file's temperatures are no kelvin
constexpr double kLeastKelvin = 100;  // a hottest voxel above this is taken as kelvin

bool is_fuel(std::string name) {
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return name == "fuel" || name == "react" || name == "combustion";
}

/// Looks for fire in a file, in what is said of it or in its usual grids.
class FireFinder {
 public:
  FireFinder(const VolumeFile& file, const Said& said, const Task& task)
      : file_(file.path), contents_(file.contents), volume_(file.plan.volumes[0]), said_(said), task_(task) {}

  Fire find() const {
    Fire fire;
    // Blender's smoke of before 2.82 calls its temperature heat.
    const bool heat_is_temperature = made_by(contents_, "blender/smoke");
    std::string temperature = chosen("volumes.0.temperature_grid", volume_.temperature_grid, GridUse::kTemperature),
                flame = chosen("volumes.0.flame_grid", volume_.flame_grid, GridUse::kFlame);
    if (heat_is_temperature && flame == "heat" && !said_("volumes.0.flame_grid")) {
      flame.clear();
      if (temperature.empty() && !said_("volumes.0.temperature_grid")) temperature = "heat";
    }
    const double flames = highest(flame), kelvin = highest(temperature);
    const bool wished = said_("volumes.0.temperature_grid") && volume_.temperature_grid != "auto";
    if (kelvin > 0 && (wished || is_fire(temperature, kelvin, flame, flames, fire))) {
      fire.temperature = temperature;
      fire.hottest = kelvin;
      if (glows(kelvin)) return fire;
      fire.why_none = fmt::format(
          "grid '{}' holds at most {:.4g} K, which does not glow; volumes.0.temperature_scale makes it hotter",
          temperature, kelvin);
      fire.temperature.clear();
    }
    if (flames > 0) {
      fire.flame = flame;
      fire.why_none.clear();
    }
    return fire;
  }

 private:
  bool glows(double hottest) const { return emitted_luminance(hottest, volume_, said_) > 0; }

  /// The grid that is said, or that the file usually has for it; empty where there is none.
  std::string chosen(const char* key, const std::string& name, GridUse use) const {
    if (said_(key) && name == "none") return "";
    if (said_(key) && name != "auto") return name;
    std::vector<std::string> ignored;
    const std::vector<GridEntry> entries = contents_.entries();
    const GridEntry* const found = usual_grid(entries, use, ignored);
    return found && (found->type == "float" || found->type == "double" || found->type == "half") ? found->name : "";
  }

  /// The largest value of a grid; 0 where it holds nothing, or there is no grid.
  double highest(const std::string& name) const {
    if (name.empty()) return 0;
    const GridSummary* const grid = find_grid(contents_, name);
    if (grid && stored_voxels(*grid) == 0.0) return 0;
    try {
      return load_scalar(file_, {.grid = name, .use = GridUse::kTemperature}, task_).bricks.maximum();
    } catch (const InputError&) {
      if (said_.any({"volumes.0.temperature_grid", "volumes.0.flame_grid"})) throw;
      return 0;  // a level set, or whatever else does not glow
    }
  }

  /// Whether a temperature that nobody asked for is one of fire, not of warm smoke.
  bool is_fire(const std::string& temperature, double kelvin, const std::string& flame, double flames,
               Fire& fire) const {
    if (flames > 0) return true;
    if (!flame.empty()) {
      fire.why_none = fmt::format(
          "nothing burns: grid '{}' holds no flames, and '{}' is what lifts the smoke; -D volumes.0.temperature_grid={} makes it glow all the same",
          flame, temperature, temperature);
      return false;
    }
    if (kelvin > kLeastKelvin || said_("volumes.0.temperature_grid")) return true;
    for (const GridSummary& grid : contents_.grids)
      if (is_fuel(grid.name) && highest(grid.name) > 0) return true;
    fire.why_none = fmt::format(
        "nothing burns: grid '{}' holds at most {:.4g}, which is no kelvin, and no flames or fuel lie beside it; -D volumes.0.temperature_grid={} makes it glow all the same",
        temperature, kelvin, temperature);
    return false;
  }

  const std::filesystem::path& file_;
  const VdbSummary& contents_;
  const VolumeSettings& volume_;
  const Said& said_;
  const Task& task_;
};

}  // namespace

Fire find_fire(const VolumeFile& file, const Said& said, const Task& task) {
  return FireFinder(file, said, task).find();
}

double kelvin_per_unit(double hottest, const VolumeSettings& volume, const Said& said) {
  if (said("volumes.0.temperature_scale")) return volume.temperature_scale;
  return hottest > kLeastKelvin ? 1.0 : std::stod(fmt::format("{:.3g}", kHottest / hottest));
}

double emitted_luminance(double hottest, const VolumeSettings& volume, const Said& said) {
  return luminance(EmissionRamp::of_blackbody(volume.temperature_offset, kelvin_per_unit(hottest, volume, said),
                                              hottest, 1, volume.blackbody_law == "planck")(hottest));
}

}  // namespace brume
