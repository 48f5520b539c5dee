#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "base/progress.h"
#include "render/scene/scene.h"
#include "render/world/volume_scene.h"

namespace brume {

/// Whether a file is an OpenVDB or NanoVDB file, by its first bytes.
bool is_volume(const std::filesystem::path& path);

/// Assignments but for those of the table `time` of a bare sequence: its files are looked at one by one.
std::vector<std::string> without_time(std::span<const std::string> overrides);

struct LoadedScene {
  Scene scene;
  std::optional<VolumeScene> made;  ///< what was made up around a bare volume
};

/// Reads a scene file, or makes up a scene around an OpenVDB file, or around a sequence of them where `path` is their
/// pattern: then of its first frame unless render.frame is said.
/// @param overrides  as read_scene   @throws InputError: as read_scene, scene_for_volume
LoadedScene load_scene(const std::filesystem::path& path, std::span<const std::string> overrides,
                       const Task& task = {});

}  // namespace brume
