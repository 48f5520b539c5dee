#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "render/guides/guides.h"
#include "render/scene/scene_outline.h"
#include "render/session/renderer.h"
#include "render/world/volume_scene.h"
#include "workflows/scene_cache.h"

namespace brume {

/// A scene that is looked at while it is edited: its file, assignments on it, and what has been computed for them. A
/// change costs what depends on it: another camera nothing, another light or material the light inside the media, and
/// volumes are read once.
class ViewedScene {
 public:
  static constexpr int kGuideSamples = 16;  ///< that guides are made for: a picture is looked at for seconds

  /// @param scene      scene file, or an OpenVDB file, around which a scene is made up; a pattern where there are
  /// frames
  /// @param frames     of a sequence; empty: a single frame
  /// @param overrides  that come before all other assignments
  /// @param layers     that are recorded when it is rendered; with guides
  ViewedScene(std::filesystem::path scene, std::vector<int> frames, std::vector<std::string> overrides,
              LayerRequest layers);

  /// The file that was read last, and when that was written.
  const std::filesystem::path& file() const { return file_; }
  std::filesystem::file_time_type written() const { return written_; }
  /// Drops what has been read, so that the next show() reads it again.
  void read_again();

  /// Makes prepared() what the assignments say. Where this throws, it stays what it was.
  /// @param frame  of a sequence; nothing: its first
  /// @return whether anything but camera and film changed
  /// @throws InputError: as parse_scene and PreparedScene; assignments that name files which the scene does not;
  ///         Interrupted
  bool show(const std::vector<std::string>& assignments, const ivec2& size, std::optional<int> frame, const Task& task);

  bool empty() const { return cache_.empty(); }
  PreparedScene& prepared() const { return cache_.last(); }
  /// Guides that are solved and marched fast, for pictures that move.
  const Guides& sketch(const Task& task) { return cache_.sketch(task); }
  /// Whether guides() gives them at once.
  bool has_guides() const { return prepared().has_guides(kGuideSamples); }
  /// Those of a picture. @throws Interrupted
  const Guides& guides(const Task& task) { return *prepared().guides(kGuideSamples, task); }

  /// Key by key, disabled entries included, as it is shown.
  const std::vector<SceneTable>& tables() const { return tables_; }
  const std::vector<int>& frames() const { return frames_; }
  std::optional<int> frame() const { return frame_; }
  /// What is assumed about a bare volume, and what the scene's loaders noted.
  std::vector<std::string> notes() const;
  /// Names of the grids in a volume's file.
  std::vector<std::string> grids(const std::string& file);
  /// The scene as a file of its own.
  std::string text() const;
  /// What renders the shown picture in full quality, for a shell.
  std::string command() const;

 private:
  void read(const std::vector<std::string>& assignments, const Task& task);
  std::vector<std::string> all_assignments(const std::vector<std::string>& assignments, const ivec2& size) const;

  std::filesystem::path path_;
  std::vector<int> frames_;
  std::vector<std::string> overrides_, assignments_;
  LayerRequest layers_;
  ivec2 size_{0};
  std::optional<int> frame_;
  std::string text_;            // of the file, or made up; empty: to be read
  std::filesystem::path file_;  // that it was read from
  std::filesystem::file_time_type written_;
  std::optional<VolumeScene> made_;
  std::vector<SceneTable> tables_;
  std::map<std::string, std::vector<std::string>> grids_;  // by file
  SceneCache cache_;
};

}  // namespace brume
