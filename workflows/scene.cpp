#include "workflows/scene.h"

#include <fmt/format.h>

#include <fstream>
#include <string_view>

#include "base/sequence.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_outline.h"
#include "volume/volume_grids.h"

namespace brume {

bool is_volume(const std::filesystem::path& path) {
  char magic[4] = {};
  std::ifstream(path, std::ios::binary).read(magic, sizeof magic);
  const std::string_view begin(magic, sizeof magic);
  return begin == " BDV" || begin == "Nano";
}

std::vector<std::string> without_time(std::span<const std::string> overrides) {
  std::vector<std::string> rest;
  for (const std::string& assignment : overrides)
    if (!assignment.starts_with("volumes.0.time.") && !assignment.starts_with("volumes.0.time="))
      rest.push_back(assignment);
  return rest;
}

namespace {

/// A sequence's first frame, or the one that is said, in the scene of all its frames; nothing where none is a volume.
std::optional<LoadedScene> load_bare_sequence(const std::filesystem::path& path, std::span<const std::string> overrides,
                                              const Task& task) {
  const auto pattern = FramePattern::of(path);
  if (!pattern || std::filesystem::exists(path)) return std::nullopt;
  std::vector<int> frames = pattern->frames_on_disk();
  std::erase_if(frames, [&](int frame) { return !is_volume(pattern->path(frame)); });
  if (frames.empty()) return std::nullopt;
  VolumeScene made = scene_for_volumes(path, frames, without_time(overrides), task);
  std::vector<std::string> all(overrides.begin(), overrides.end());
  if (!assigned_keys(overrides).contains("render.frame")) all.push_back(fmt::format("render.frame={}", frames[0]));
  Scene scene = parse_scene(made.text(path.filename().string()), path, all);
  return LoadedScene{std::move(scene), std::move(made)};
}

}  // namespace

LoadedScene load_scene(const std::filesystem::path& path, std::span<const std::string> overrides, const Task& task) {
  if (auto sequence = load_bare_sequence(path, overrides, task)) return std::move(*sequence);
  if (!is_volume(path)) return {read_scene(path, overrides), std::nullopt};
  VolumeScene made = scene_for_volume(path, overrides, task);
  Scene scene = parse_scene(made.text(path.filename().string()), path, overrides);
  if (scene.volumes.empty()) return {std::move(scene), std::move(made)};
  VolumeSettings& volume = scene.volumes[0];
  if (std::error_code error; made.density && std::filesystem::equivalent(volume.file, path, error) &&
                             volume.grid == made.density->summary.name) {
    VolumeGrids grids;
    grids.density = made.density;
    volume.grids = std::make_shared<const VolumeGrids>(std::move(grids));
  }
  return {std::move(scene), std::move(made)};
}

}  // namespace brume
