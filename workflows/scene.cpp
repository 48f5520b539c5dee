#include "workflows/scene.h"

#include <fstream>
#include <string_view>

#include "render/scene/scene_io.h"
#include "volume/volume_grids.h"

namespace brume {

bool is_volume(const std::filesystem::path& path) {
  char magic[4] = {};
  std::ifstream(path, std::ios::binary).read(magic, sizeof magic);
  return std::string_view(magic, sizeof magic) == std::string_view(" BDV", 4);
}

LoadedScene load_scene(const std::filesystem::path& path, std::span<const std::string> overrides, const Task& task) {
  if (!is_volume(path)) return {read_scene(path, overrides), std::nullopt};
  VolumeScene made = scene_for_volume(path, task);
  Scene scene = parse_scene(made.text(path.filename().string()), path, overrides);
  VolumeSettings& volume = scene.volumes.at(0);
  if (std::error_code error;
      std::filesystem::equivalent(volume.file, path, error) && volume.grid == made.density->summary.name) {
    VolumeGrids grids;
    grids.density = made.density;
    volume.grids = std::make_shared<const VolumeGrids>(std::move(grids));
  }
  return {std::move(scene), std::move(made)};
}

}  // namespace brume
