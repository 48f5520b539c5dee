#include "workflows/scene.h"

#include <fstream>
#include <string_view>

#include "render/scene/scene_io.h"

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
  std::error_code error;
  if (std::filesystem::equivalent(scene.volumes.at(0).file, path, error)) scene.volumes[0].field = made.density;
  return {std::move(scene), std::move(made)};
}

}  // namespace brume
