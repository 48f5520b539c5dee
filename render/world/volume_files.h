#pragma once
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/progress.h"
#include "render/scene/scene.h"
#include "volume/vdb_io.h"

namespace brume {

// How a scene is made up around bare volumes (volume_scene.h): what is said of it, and which files are looked at.

/// What has been said before anything is guessed.
class Said {
 public:
  /// @throws InputError for what is no assignment
  explicit Said(std::span<const std::string> assignments);
  bool operator()(const std::string& key) const { return keys_.contains(key); }
  bool any(std::initializer_list<const char*> keys) const {
    for (const char* key : keys)
      if (keys_.contains(key)) return true;
    return false;
  }
  bool camera_moves_or_is_given() const { return any({"camera.keys", "camera.from_exr"}); }
  bool extinction() const {
    return any({"volumes.0.sigma_t", "volumes.0.sigma_a", "volumes.0.sigma_s", "volumes.0.preset"});
  }

 private:
  std::set<std::string> keys_;
};

/// A volume's file by its table of contents, and the scene around it as far as that is known.
struct VolumeFile {
  std::filesystem::path path;
  Scene plan;  ///< with what is said, and the guesses that need no look at the volume
  VdbSummary contents;
  std::string grid;                ///< its density; empty: it holds no grid
  std::vector<std::string> notes;  ///< on the choice of that
  double voxels = 0;               ///< active ones; infinite where the file does not say
  std::optional<VoxelBox> box;     ///< of them
  double burning = 0;              ///< grows with the active voxels of its flames, or else of its temperature
};

/// Reads a file's table of contents. @param frame  of a sequence, whose name `pattern` is
/// @throws InputError for a file that cannot be read or has no density, and as parse_scene
VolumeFile volume_file(const std::filesystem::path& pattern, std::optional<int> frame, const Said& said,
                       std::span<const std::string> assignments, const Task& task);

/// Those of a sequence that can be read and whose density has the name that most of them give it; of a long sequence
/// every few. @throws InputError where there is none
std::vector<VolumeFile> volume_files(const std::filesystem::path& pattern, std::span<const int> frames,
                                     const Said& said, std::span<const std::string> assignments, const Task& task);

/// Those of a sequence whose volumes are worth reading: the one with the most voxels first, then those that reach
/// farthest beyond the others, and the one with most fire.
std::vector<const VolumeFile*> files_that_matter(const std::vector<VolumeFile>& files);

/// Null where there is no grid of this name.
const GridSummary* find_grid(const VdbSummary& file, const std::string& name);

/// Active voxels by the grid's metadata, which most writers leave.
std::optional<double> stored_voxels(const GridSummary& grid);

/// Whether a program left its name, or a key that begins with it, in the metadata.
bool made_by(const VdbSummary& file, std::string_view program);

}  // namespace brume
