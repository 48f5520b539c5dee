#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace brume {

/// What a grid is read for.
enum class GridUse : uint8_t { kDensity, kTemperature, kFlame, kColour, kVelocity };

/// A grid as its file's table of contents has it.
struct GridEntry {
  std::string name;  ///< as it is asked for: "density"; "density[1]" where several have that name; "[0]" without a name
  std::string type;  ///< OpenVDB's name: float, vec3s, ...
  std::string grid_class;  ///< as GridSummary::grid_class
};

/// What a scene finds under "auto" and, for the density, under no name. Capital letters, and spaces, dots and dashes in
/// the place of underscores, make no difference where no grid has the exact name.
const std::vector<std::string>& usual_grid_names(GridUse use);

/// The name without the number that tells grids of one name apart.
std::string grid_name_alone(const std::string& name);

/// A coarser level of detail of another grid of its file, as "density_level_1" is of "density" or "density_level_0": it
/// is no field of its own. The finest that there is, is none.
struct GridLevel {
  std::string of;  ///< the finest one's name
  int level;       ///< 1 and more
};
std::optional<GridLevel> level_of(const std::vector<GridEntry>& grids, const std::string& name);

/// "grid 'soot'", "the grid [0], which has no name".
std::string grid_text(const std::string& name);

/// "density (float), velocity (vec3s)"; "none".
std::string grids_text(const std::vector<GridEntry>& grids);

/// The grid that is meant where none is named: the first of the usual names. For a density also the one grid whose name
/// holds "density", a file's only scalar grid whatever its name, or the only one that is not known to be something
/// else. Coarser levels of detail are none of these.
/// @param notes  told what is not plain
/// @return null where there is none
/// @throws InputError, without the file's name, where several could be the density
const GridEntry* usual_grid(const std::vector<GridEntry>& grids, GridUse use, std::vector<std::string>& notes);

/// The grid of this very name; of several that have it the first, with a note. Null where there is none.
const GridEntry* named_grid(const std::vector<GridEntry>& grids, const std::string& name,
                            std::vector<std::string>& notes);

}  // namespace brume
