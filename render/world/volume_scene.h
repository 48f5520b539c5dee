#pragma once
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/progress.h"

namespace brume {

struct ScalarField;

/// A scene around a volume file or a sequence of them, and what was assumed, a line each.
struct VolumeScene {
  /// The text of a scene file. @param file  how it names the volume, relative to its own folder
  std::string text(const std::string& file) const;
  /// Everything that was assumed, the camera included.
  std::vector<std::string> all_assumptions() const;

  std::string before_file, after_file;         ///< the text around the volume's name, which stands in quotes
  std::vector<std::string> assumptions;        ///< all but the camera's
  std::string camera_assumption;               ///< empty: the assignments say where it is
  std::shared_ptr<const ScalarField> density;  ///< of one file, as it is stored: for VolumeSettings::grids; may be null
};

/// A scene for a bare OpenVDB file: the camera frames what is seen of the density, the extinction gives a sensible
/// optical depth whatever the scale, sun and sky light it, and it burns where the file holds a fire: flames, or
/// temperatures in kelvin. A grid of flames without any means that nothing burns.
/// @param assignments  "film.width=30": what is said is not guessed, and the rest is made to go with it
/// @throws InputError: as read_vdb_info, load_scalar and parse_scene; a density without anything in it
VolumeScene scene_for_volume(const std::filesystem::path& file, std::span<const std::string> assignments = {},
                             const Task& task = {});

/// One scene for all frames of a sequence: camera, extinction and fire are the same in each. All tables of contents are
/// looked at, of long sequences every few, and of the volumes those that reach farthest and burn most.
/// @param pattern  name of the files, or of one   @param frames  rising, at least one
/// @throws InputError: as for one file, where no frame can be looked at
VolumeScene scene_for_volumes(const std::filesystem::path& pattern, std::span<const int> frames,
                              std::span<const std::string> assignments = {}, const Task& task = {});

}  // namespace brume
