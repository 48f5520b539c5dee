#include "volume/grid_names.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>

#include "base/error.h"
#include "base/text.h"

namespace brume {
namespace {

// Of Blender (Mantaflow, its older smoke), Houdini, EmberGen, FumeFX, Phoenix, Bifrost, Maya, Cinema 4D, TurbulenceFD.
const std::vector<std::string> kDensity = {
    "density",           "density_noise", "density_high", "smoke", "smoke_density", "fog_density",
    "voxel_fog_density", "voxel_density", "voxel_smoke",  "fog",   "cloud",         "clouds"};
const std::vector<std::string> kTemperature = {"temperature", "temp", "voxel_temperature", "temperature_noise"};
const std::vector<std::string> kFlame = {"flame", "flames",  "flame_noise", "flame_high", "fire",
                                         "burn",  "burning", "voxel_flame", "voxel_fire", "heat"};
const std::vector<std::string> kColour = {"color", "Cd", "colour", "rgb", "albedo", "voxel_color", "scatter_color"};
const std::vector<std::string> kVelocity = {"velocity", "vel", "v", "voxel_velocity"};
// Scalars that simulations keep beside a density.
const std::vector<std::string> kNoDensity = {
    "shadow",     "fuel",     "fuel_noise", "react",         "react_noise",   "pressure",     "divergence",
    "vorticity",  "curl",     "speed",      "flags",         "mask",          "collision",    "obstacle",
    "source",     "age",      "distance",   "sdf",           "surface",       "liquid",       "voxel_signed_distance",
    "emission",   "heat_old", "velocity_x", "velocity_y",    "vel_x",         "vel_y",        "vel_z",
    "velocity_z", "v_x",      "v_y",        "v_z",           "color_r",       "cd_r",         "color_g",
    "cd_g",       "color_b",  "cd_b",       "color_r_noise", "color_g_noise", "color_b_noise"};

/// Small letters, with underscores between words.
std::string plain(const std::string& name) {
  std::string text = name;
  for (char& c : text)
    c = c == ' ' || c == '-' || c == '.' ? '_' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// "density" and 1 of "density_level_1".
std::optional<std::pair<std::string, int>> split_level(const std::string& name) {
  constexpr std::string_view kLevel = "_level_";
  constexpr size_t kMostDigits = 3;
  const size_t at = name.rfind(kLevel), digits = at + kLevel.size();
  if (at == std::string::npos || at == 0 || digits == name.size() || name.size() > digits + kMostDigits ||
      !std::all_of(name.begin() + static_cast<std::ptrdiff_t>(digits), name.end(),
                   [](unsigned char c) { return std::isdigit(c) != 0; }))
    return std::nullopt;
  return std::pair(name.substr(0, at), std::stoi(name.substr(digits)));
}

bool has_grid(const std::vector<GridEntry>& grids, const std::string& name) {
  return std::any_of(grids.begin(), grids.end(), [&](const GridEntry& grid) { return grid.name == name; });
}

/// The finest level that there is of a grid: "density_level_1" where 1 and 2 are; empty where there is none.
std::string finest_level(const std::vector<GridEntry>& grids, const std::string& of) {
  std::string finest;
  std::optional<int> least;
  for (const GridEntry& grid : grids)
    if (const auto level = split_level(grid.name); level && level->first == of && (!least || level->second < *least)) {
      least = level->second;
      finest = grid.name;
    }
  return finest;
}

void note_coarse(const std::string& grid, std::vector<std::string>& notes) {
  if (const auto level = split_level(grid); level && level->second > 0)
    notes.push_back(
        fmt::format("no grid '{}', nor its level 0: '{}', the finest that there is, is used", level->first, grid));
}

bool is_scalar(const GridEntry& grid) {
  return grid.type == "float" || grid.type == "double" || grid.type == "half";
}

/// Masks and whole numbers can be a density, too.
bool is_countable(const GridEntry& grid) {
  return grid.type == "bool" || grid.type == "mask" || grid.type == "int32" || grid.type == "int64";
}

bool is_one_of(const std::vector<std::string>& names, const std::string& plain_name) {
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) { return plain(name) == plain_name; });
}

/// Of a name that several grids have the first, with a note.
const GridEntry* first_of(const std::vector<const GridEntry*>& same, std::vector<std::string>& notes) {
  if (same.size() > 1)
    notes.push_back(fmt::format("{} grids {}: '{}' is used, the others can be named as '{}'", same.size(),
                                grid_name_alone(same[0]->name).empty()
                                    ? "have no name"
                                    : fmt::format("are named '{}'", grid_name_alone(same[0]->name)),
                                same[0]->name, same[1]->name));
  return same.empty() ? nullptr : same[0];
}

template <class Fits>
std::vector<const GridEntry*> those(const std::vector<GridEntry>& grids, const Fits& fits) {
  std::vector<const GridEntry*> found;
  for (const GridEntry& grid : grids)
    if (fits(grid)) found.push_back(&grid);
  return found;
}

/// @param of_kind  whether grids of other types are passed over
const GridEntry* of_usual_name(const std::vector<GridEntry>& grids, GridUse use, bool of_kind,
                               std::vector<std::string>& notes) {
  const bool vector = use == GridUse::kColour || use == GridUse::kVelocity;
  const auto fits = [&](const GridEntry& grid) {
    return !of_kind || (vector ? grid.type.starts_with("vec3") : is_scalar(grid) || is_countable(grid));
  };
  for (const std::string& name : usual_grid_names(use)) {
    auto same = those(grids, [&](const GridEntry& g) { return fits(g) && grid_name_alone(g.name) == name; });
    if (same.empty())
      same = those(grids, [&](const GridEntry& g) { return fits(g) && plain(grid_name_alone(g.name)) == plain(name); });
    if (!same.empty()) return first_of(same, notes);
  }
  return nullptr;
}

std::string names_text(const std::vector<const GridEntry*>& grids) {
  std::vector<std::string> names;
  for (const GridEntry* grid : grids) names.push_back(fmt::format("'{}'", grid->name));
  return join(names);
}

/// The one of several grids that may be the density. @throws InputError where they differ in their names
const GridEntry* only_one(const std::vector<const GridEntry*>& candidates, std::vector<std::string>& notes) {
  const bool one_name = std::all_of(candidates.begin(), candidates.end(), [&](const GridEntry* grid) {
    return grid_name_alone(grid->name) == grid_name_alone(candidates[0]->name);
  });
  if (one_name) return first_of(candidates, notes);
  throw InputError(fmt::format("no grid 'density', and several that could be it: {}; name one of them with grid = ...",
                               names_text(candidates)));
}

const GridEntry* density_by_exclusion(const std::vector<GridEntry>& grids, std::vector<std::string>& notes) {
  const auto with_density = those(
      grids, [](const GridEntry& g) { return is_scalar(g) && plain(g.name).find("density") != std::string::npos; });
  if (!with_density.empty()) return only_one(with_density, notes);
  const auto scalars = those(grids, is_scalar),
             countable = those(grids, [](const GridEntry&g) {
               return is_countable(g) && !is_one_of(kNoDensity, plain(grid_name_alone(g.name)));
             });
  if (scalars.size() == 1) return scalars[0];
  if (scalars.empty() && countable.size() == 1) return countable[0];
  const auto candidates = those(grids, [](const GridEntry& g) {
    const std::string name = plain(grid_name_alone(g.name));
    return is_scalar(g) && g.grid_class != "level set" && !name.starts_with("phi") && !is_one_of(kTemperature, name) &&
           !is_one_of(kFlame, name) && !is_one_of(kNoDensity, name);
  });
  return candidates.empty() ? nullptr : only_one(candidates, notes);
}

}  // namespace

const std::vector<std::string>& usual_grid_names(GridUse use) {
  switch (use) {
    case GridUse::kTemperature:
      return kTemperature;
    case GridUse::kFlame:
      return kFlame;
    case GridUse::kColour:
      return kColour;
    case GridUse::kVelocity:
      return kVelocity;
    default:
      return kDensity;
  }
}

std::string grid_name_alone(const std::string& name) {
  const size_t open = name.rfind('[');
  const bool numbered = open != std::string::npos && open + 2 < name.size() && name.back() == ']' &&
                        std::all_of(name.begin() + static_cast<std::ptrdiff_t>(open) + 1, name.end() - 1,
                                    [](unsigned char c) { return std::isdigit(c) != 0; });
  return numbered ? name.substr(0, open) : name;
}

std::string grid_text(const std::string& name) {
  return grid_name_alone(name).empty() ? fmt::format("the unnamed grid '{}'", name) : fmt::format("grid '{}'", name);
}

std::string grids_text(const std::vector<GridEntry>& grids) {
  std::vector<std::string> texts;
  for (const GridEntry& grid : grids)
    texts.push_back(grid_name_alone(grid.name).empty()
                        ? fmt::format("an unnamed grid ({}), which is asked for as '{}'", grid.type, grid.name)
                        : fmt::format("{} ({})", grid.name, grid.type));
  return texts.empty() ? "none" : join(texts);
}

std::optional<GridLevel> level_of(const std::vector<GridEntry>& grids, const std::string& name) {
  const auto level = split_level(name);
  if (!level || level->second == 0) return std::nullopt;
  if (has_grid(grids, level->first)) return GridLevel{level->first, level->second};
  const std::string finest = finest_level(grids, level->first);
  return finest == name ? std::nullopt : std::optional(GridLevel{finest, level->second});
}

const GridEntry* usual_grid(const std::vector<GridEntry>& all, GridUse use, std::vector<std::string>& notes) {
  // The finest levels, under the names that they would have alone.
  std::vector<GridEntry> grids;
  std::vector<const GridEntry*> originals;
  for (const GridEntry& grid : all) {
    if (level_of(all, grid.name)) continue;
    const auto level = split_level(grid.name);
    originals.push_back(&grid);
    grids.push_back(grid);
    if (level && !has_grid(all, level->first)) grids.back().name = level->first;
  }
  const GridEntry* found = of_usual_name(grids, use, /*of_kind=*/true, notes);
  if (!found && use == GridUse::kDensity) found = density_by_exclusion(grids, notes);
  if (!found) found = of_usual_name(grids, use, /*of_kind=*/false, notes);  // whose type is then refused
  const std::string& usual = usual_grid_names(use).front();
  if (found && use == GridUse::kDensity && grid_name_alone(found->name) != usual)
    notes.push_back(fmt::format("no grid '{}'; {} is used", usual, grid_text(found->name)));
  if (!found) return nullptr;
  const GridEntry* original = originals[static_cast<size_t>(found - grids.data())];
  note_coarse(original->name, notes);
  return original;
}

const GridEntry* named_grid(const std::vector<GridEntry>& grids, const std::string& name,
                            std::vector<std::string>& notes) {
  for (const GridEntry& grid : grids)
    if (grid.name == name) return &grid;
  const std::string alone = grid_name_alone(name);
  const auto same = those(grids, [&](const GridEntry& g) { return grid_name_alone(g.name) == alone; });
  if (name == alone && !same.empty()) return first_of(same, notes);
  if (same.size() == 1 && name == alone + "[0]") return same[0];
  const std::string finest = finest_level(grids, name);
  for (const GridEntry& grid : grids)
    if (!finest.empty() && grid.name == finest) {
      note_coarse(finest, notes);
      return &grid;
    }
  return nullptr;
}

}  // namespace brume
