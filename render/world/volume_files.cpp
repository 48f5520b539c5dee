#include "render/world/volume_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <limits>
#include <map>

#include "base/error.h"
#include "base/sequence.h"
#include "base/toml_text.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_outline.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 800, kHeight = 600;
constexpr double kFov = 32;            // degrees along the height
constexpr size_t kMostContents = 100;  // tables of contents that are read of a sequence
constexpr size_t kMostLooked = 5;      // volumes that are
constexpr double kFarther = 0.02;      // of the sequence's size: a frame that reaches so much farther is looked at

/// What of the scene is said or needs no look at the volume, as it will be read.
Scene plan(const fs::path& pattern, std::optional<int> frame, const Said& said,
           std::span<const std::string> assignments) {
  const fs::path file = frame ? file_of_frame(pattern, *frame) : pattern;
  std::string text = fmt::format("[camera]\nfov = {}\nfov_axis = \"y\"\n", kFov);
  if (!said.camera_moves_or_is_given()) text += "position = [0, 0, 0]\nlook_at = [0, 1, 0]\n";
  text += fmt::format(
      "[film]\nwidth = {}\nheight = {}\n[[volumes]]\nfile = {}\n"
      "[[lights]]\ntype = \"sun\"\ndirection = [0, 0, 1]\nirradiance = 1\n",
      kWidth, kHeight, toml_string(file.filename().string()));
  std::vector<std::string> all(assignments.begin(), assignments.end());
  if (frame) all.push_back(fmt::format("render.frame={}", *frame));
  all.push_back("volumes.0.enabled=true");
  return parse_scene_alone(text, file, all);
}

std::optional<VoxelBox> stored_box(const GridSummary& grid) {
  VoxelBox box;
  for (const auto& [key, corner] : {std::pair("file_bbox_min", &box.lo), {"file_bbox_max", &box.hi}}) {
    const auto found = grid.metadata.find(key);
    if (found == grid.metadata.end() ||
        std::sscanf(found->second.c_str(), "[%d, %d, %d]", &corner->x, &corner->y, &corner->z) != 3)
      return std::nullopt;
  }
  return box.empty() ? std::nullopt : std::optional(box);
}

/// Of each frame, or in a long sequence of every few. @throws InputError where none can be read
std::vector<VolumeFile> readable_files(const fs::path& pattern, std::span<const int> frames, const Said& said,
                                       std::span<const std::string> assignments, const Task& task) {
  std::vector<VolumeFile> files;
  std::string first_error;
  const size_t count = std::min(frames.size(), kMostContents);
  for (size_t i = 0; i < count; ++i) {
    const int frame = frames[count > 1 ? i * (frames.size() - 1) / (count - 1) : 0];
    try {
      files.push_back(volume_file(pattern, frame, said, assignments, task));
    } catch (const InputError& error) {  // told when the frame is rendered
      if (first_error.empty()) first_error = error.what();
    }
  }
  if (files.empty()) throw InputError(first_error);
  return files;
}

/// Those whose density has the name that most of them have.
std::vector<VolumeFile> of_one_grid(std::vector<VolumeFile> files) {
  std::map<std::string, int> counts;
  for (const VolumeFile& file : files)
    if (!file.grid.empty()) ++counts[file.grid];
  std::string most;
  for (const VolumeFile& file : files)
    if (!file.grid.empty() && (most.empty() || counts[file.grid] > counts[most])) most = file.grid;
  if (most.empty())
    throw InputError(fmt::format("{}: no frame holds a grid, there is nothing to render", files[0].path.string()));
  std::erase_if(files, [&](const VolumeFile& file) { return file.grid != most; });
  return files;
}

}  // namespace

Said::Said(std::span<const std::string> assignments) : keys_(assigned_keys(assignments)) {}

bool made_by(const VdbSummary& file, std::string_view program) {
  const auto tells = [&](const std::map<std::string, std::string>& metadata) {
    return std::any_of(metadata.begin(), metadata.end(), [&](const auto& entry) {
      return entry.first.find(program) != std::string::npos || entry.second.find(program) != std::string::npos;
    });
  };
  return tells(file.metadata) ||
         std::any_of(file.grids.begin(), file.grids.end(), [&](const GridSummary& g) { return tells(g.metadata); });
}

const GridSummary* find_grid(const VdbSummary& file, const std::string& name) {
  const auto found =
      std::find_if(file.grids.begin(), file.grids.end(), [&](const GridSummary& g) { return g.name == name; });
  return found == file.grids.end() ? nullptr : &*found;
}

std::optional<double> stored_voxels(const GridSummary& grid) {
  const auto found = grid.metadata.find("file_voxel_count");
  return found == grid.metadata.end() ? std::nullopt : std::optional(std::strtod(found->second.c_str(), nullptr));
}

VolumeFile volume_file(const fs::path& pattern, std::optional<int> frame, const Said& said,
                       std::span<const std::string> assignments, const Task& task) {
  VolumeFile file;
  file.plan = plan(pattern, frame, said, assignments);
  if (file.plan.volumes.empty() || file.plan.volumes[0].file.empty())
    throw InputError(fmt::format("{}: no volume is left to make a scene around", pattern.string()));
  const VolumeSettings& volume = file.plan.volumes[0];
  file.path = volume.file;
  file.contents = read_vdb_contents(file.path, task);
  if (file.contents.grids.empty()) return file;
  const std::vector<GridEntry> entries = file.contents.entries();
  const auto list = [&] { return "the file has: " + grids_text(entries); };
  const GridEntry* found = nullptr;
  try {
    found = volume.grid.empty() ? usual_grid(entries, GridUse::kDensity, file.notes)
                                : named_grid(entries, volume.grid, file.notes);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}. {}: -D volumes.0.grid=NAME", file.path.string(), error.what(), list()));
  }
  if (!found)
    throw InputError(fmt::format("{}: no grid '{}'; {}; -D volumes.0.grid=NAME takes another", file.path.string(),
                                 volume.grid.empty() ? "density" : volume.grid, list()));
  file.grid = found->name;
  if (const GridSummary* const grid = find_grid(file.contents, file.grid)) {
    file.voxels = stored_voxels(*grid).value_or(std::numeric_limits<double>::infinity());
    file.box = stored_box(*grid);
  }
  for (const GridUse use : {GridUse::kFlame, GridUse::kTemperature}) {
    std::vector<std::string> ignored;
    const GridEntry* const glowing = usual_grid(entries, use, ignored);
    if (!glowing) continue;
    const double voxels = stored_voxels(*find_grid(file.contents, glowing->name)).value_or(1);
    file.burning = std::max(file.burning, use == GridUse::kFlame ? 1e12 * voxels : voxels);  // flames say more
  }
  return file;
}

std::vector<VolumeFile> volume_files(const fs::path& pattern, std::span<const int> frames, const Said& said,
                                     std::span<const std::string> assignments, const Task& task) {
  return of_one_grid(readable_files(pattern, frames, said, assignments, task));
}

std::vector<const VolumeFile*> files_that_matter(const std::vector<VolumeFile>& files) {
  std::vector<const VolumeFile*> rest, chosen;
  for (const VolumeFile& file : files)
    if (file.voxels > 0) rest.push_back(&file);
  if (rest.empty()) return {&files.front()};
  const auto take = [&](std::vector<const VolumeFile*>::iterator file) {
    chosen.push_back(*file);
    rest.erase(file);
  };
  const auto by = [](double VolumeFile::*what) {
    return [what](const VolumeFile* a, const VolumeFile* b) { return a->*what < b->*what; };
  };
  const bool known =
      std::all_of(rest.begin(), rest.end(), [](const VolumeFile* file) { return file->box.has_value(); });
  if (!known) {  // first, middle and last will do
    const std::vector<const VolumeFile*> all = rest;
    chosen = {all.back()};
    for (const VolumeFile* file : {all.front(), all[all.size() / 2]})
      if (std::find(chosen.begin(), chosen.end(), file) == chosen.end()) chosen.push_back(file);
    std::erase_if(rest,
                  [&](const VolumeFile* f) { return std::find(chosen.begin(), chosen.end(), f) != chosen.end(); });
  } else {
    take(std::max_element(rest.begin(), rest.end(), by(&VolumeFile::voxels)));
    VoxelBox box = *chosen[0]->box;
    const auto beyond = [&](const VolumeFile* file) {
      const ivec3 more = glm::max(box.lo - file->box->lo, file->box->hi - box.hi), size = box.hi - box.lo + 1;
      return std::max({1.0 * more.x / size.x, 1.0 * more.y / size.y, 1.0 * more.z / size.z});
    };
    while (!rest.empty() && chosen.size() + 1 < kMostLooked) {
      const auto farthest = std::max_element(
          rest.begin(), rest.end(), [&](const VolumeFile* a, const VolumeFile* b) { return beyond(a) < beyond(b); });
      if (beyond(*farthest) < kFarther) break;
      box = {glm::min(box.lo, (*farthest)->box->lo), glm::max(box.hi, (*farthest)->box->hi)};
      take(farthest);
    }
  }
  const auto hottest = std::max_element(rest.begin(), rest.end(), by(&VolumeFile::burning));
  if (hottest != rest.end() && std::none_of(chosen.begin(), chosen.end(),
                                            [&](const VolumeFile* f) { return f->burning >= (*hottest)->burning; }))
    take(hottest);
  return chosen;
}

}  // namespace brume
