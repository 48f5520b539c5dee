#pragma once
#include <atomic>
#include <filesystem>
#include <future>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "render/guides/guides.h"
#include "render/scene/scene_outline.h"
#include "render/session/renderer.h"
#include "render/world/volume_scene.h"
#include "workflows/mix_lights.h"
#include "workflows/scene_cache.h"

namespace brume {

/// What a scene that is looked at was read from: enough to write it down in any state, from any thread.
struct ViewedText {
  std::filesystem::path path;  ///< as it was given; a pattern where there are frames
  std::vector<int> frames;
  std::vector<std::string> overrides;
  std::string text = {};  ///< of the file, or made up; empty: not read yet
  /// What was made up around a bare volume and would be made up anew for another picture, and the size it was for.
  std::vector<std::string> guessed = {};
  ivec2 guessed_for{0};

  /// All that stand on the text. @param size  none where 0   @param frame  one of frames, else the first of them
  std::vector<std::string> assignments(const std::vector<std::string>& own, const ivec2& size,
                                       std::optional<int> frame) const;
  /// The scene as a file of its own. @throws InputError: as edited_scene; not read yet
  std::string scene(const std::vector<std::string>& own, const ivec2& size, std::optional<int> frame) const;
  /// What renders it in full quality, for a shell: with what was guessed, where that would not be guessed again.
  std::string command(const std::vector<std::string>& own, const ivec2& size, std::optional<int> frame) const;
  /// Assignments and what makes the scene's lights as they are mixed. @throws InputError: as scene, assignments_of_mix
  std::vector<std::string> mixed(std::vector<std::string> own, const ivec2& size, std::optional<int> frame,
                                 const LightMix& mix) const;
  std::optional<int> frame_of(std::optional<int> frame) const;
};

/// A grid of a file that a volume could take.
struct GridChoice {
  std::string name, type;
  bool usable = false;  ///< as a density
};

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

  /// The file that was read last and every file that the scene names, as far as known, whether or not they are there.
  std::vector<std::filesystem::path> files() const;
  /// Drops what has been read, so that the next show() reads it again.
  void read_again();
  /// Has the next show() read the scene's text again, and of the files that it names those that are new.
  void read_text_again() { source_.text.clear(); }

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
  /// The scene's picture alone, path traced at a size.
  Layers coarse(const ivec2& size, int samples, const Task& task);
  /// Whether guides() gives them at once.
  bool has_guides() const { return prepared().has_guides(kGuideSamples); }
  /// Those of a picture. They are solved on a thread of their own, which goes on where the task is interrupted, until
  /// show() changes what they depend on. @throws Interrupted
  const Guides& guides(const Task& task);

  /// Key by key, disabled entries included, as it is shown.
  const std::vector<SceneTable>& tables() const { return tables_; }
  const std::vector<int>& frames() const { return source_.frames; }
  std::optional<int> frame() const { return frame_; }
  /// Its name; of a sequence that of all its frames together.
  std::string title() const;
  /// Fingerprint of the scene that is shown, as `brume render` writes it: hash and settings. Reads its files once.
  std::pair<std::string, std::string> fingerprint();
  /// What is assumed about a bare volume, and what the scene's loaders noted.
  std::vector<std::string> notes() const;
  /// Names of the grids in a volume's file.
  std::vector<std::string> grids(const std::string& file);
  /// After show() has thrown: the grids to choose from instead of one that is not there or holds no density, and the
  /// key to assign; none where that is not what is wrong.
  std::pair<std::string, std::vector<GridChoice>> grids_instead() const;
  const ViewedText& source() const { return source_; }

 private:
  struct Solving {
    std::atomic<bool> cancel{false};
    std::atomic<double> share{0};
    std::future<void> done;
    ~Solving() {
      cancel = true;
      if (done.valid()) done.wait();
    }
  };
  void read(const std::vector<std::string>& assignments, const ivec2& size, const Task& task);

  ViewedText source_;
  LayerRequest layers_;
  std::optional<int> frame_;
  std::filesystem::path file_;       // that the text was read from
  std::set<std::string> named_;      // files, as the scene that was tried last names them
  std::vector<std::string> guess_;   // assignments that decide what is made up around a volume
  std::vector<std::string> wanted_;  // the assignments that were tried last
  Scene scene_;                      // that is shown, before files were read
  std::optional<VolumeScene> made_;
  std::vector<SceneTable> tables_;
  std::map<std::string, std::vector<std::string>> grids_;  // by file
  SceneCache cache_;
  std::unique_ptr<Solving> solving_;  // of cache_.last()
};

}  // namespace brume
