#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "base/progress.h"

namespace brume {

/// A scene around a volume file, as the text of a scene file, and what was assumed, a line each.
struct VolumeScene {
  std::string text;
  std::vector<std::string> assumptions;
};

/// A scene for a bare OpenVDB file: the camera frames the grid's bounds, the extinction gives a sensible optical depth
/// whatever the scale, sun and sky light it, temperature or flame make it burn.
/// @param name_in_scene  how the scene names the file, relative to the scene's own folder
/// @throws InputError: as read_vdb_info and load_scalar; a density without anything in it
VolumeScene scene_for_volume(const std::filesystem::path& file, const std::string& name_in_scene,
                             const Task& task = {});

}  // namespace brume
