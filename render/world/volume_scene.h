#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/progress.h"

namespace brume {

struct ScalarField;

/// A scene around a volume file, and what was assumed, a line each.
struct VolumeScene {
  /// The text of a scene file. @param file  how it names the volume, relative to its own folder
  std::string text(const std::string& file) const;

  std::string before_file, after_file;  ///< the text around the volume's name
  std::vector<std::string> assumptions;
  std::shared_ptr<const ScalarField> density;  ///< as it was read, for VolumeSettings::grids
};

/// A scene for a bare OpenVDB file: the camera frames the grid's bounds, the extinction gives a sensible optical depth
/// whatever the scale, sun and sky light it, temperature or flame make it burn.
/// @throws InputError: as read_vdb_info and load_scalar; a density without anything in it
VolumeScene scene_for_volume(const std::filesystem::path& file, const Task& task = {});

}  // namespace brume
