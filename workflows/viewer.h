#pragma once
#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "image/layers.h"
#include "render/scene/scene_outline.h"
#include "workflows/clean.h"
#include "workflows/host.h"
#include "workflows/mix_lights.h"
#include "workflows/viewed_scene.h"

namespace brume {

/// What is looked at: the whole of it, each time.
struct ViewLook {
  uint64_t id = 0;  ///< what is shown names it
  std::vector<std::string> assignments;
  ivec2 size{0};
  bool moving = false;              ///< more of them follow at once: answered fast, at lower resolution
  std::vector<std::string> layers;  ///< that are shown, by names out of ViewSceneText::layers
  std::optional<int> frame;
  bool needs_scene = false;    ///< who looks has been told nothing of the scene yet
  int most_samples = 1 << 20;  ///< per pixel
  /// Of light groups, in what is shown and kept; nothing is rendered again for it.
  LightMix mix = {};
  /// Of the scene's text: where another one was looked at before, the file is read again, and of those that it names
  /// the ones that are new.
  uint64_t revision = 0;

  /// Whether the same is rendered for it, of whichever layers and mix.
  bool shows_as(const ViewLook& other) const {
    return assignments == other.assignments && size == other.size && frame == other.frame &&
           most_samples == other.most_samples && revision == other.revision;
  }
};

/// A point of the picture that somebody points at, from the top left corner, 0 to 1.
struct ViewProbe {
  uint64_t id = 0;
  dvec2 at{0};
};

/// One layer as half floats, channel by channel, rows from the top.
struct ViewPicture {
  uint64_t id = 0;
  std::string layer;
  int width = 0, height = 0, channels = 0;
  bool predicted = false;   ///< from guides alone; else path traced and clean
  bool full = true;         ///< of the size asked for, and no better prediction follows
  bool misses_mix = false;  ///< lights are as rendered, although a mix is asked for: it is not known by light group
  int samples = 0;          ///< per pixel, on average
  std::optional<double> error;
  double seconds = 0;  ///< since it was asked for
  double exposure = 1;
  std::optional<int> frame;
  std::vector<uint16_t> halves;
};

/// What a page needs to know of the scene.
struct ViewSceneText {
  struct Layer {
    std::string name, title;
    int channels;
    std::string group = "", unit = "";  ///< under which it is listed; of its values
    friend bool operator==(const Layer&, const Layer&) = default;
  };
  struct Table {
    SceneTable keys;
    std::string title;
    std::vector<std::string> grids;              ///< of a volume's file
    std::optional<std::array<double, 3>> depth;  ///< of a volume: optical depth through its middle along the axes
  };
  uint64_t id = 0;
  std::string name, command;
  bool reloaded = false;  ///< the file has changed
  std::vector<int> frames;
  dvec3 lo{0}, hi{0};  ///< of what the volumes and lights that are seen fill
  std::vector<Layer> layers;
  std::vector<std::string> light_groups;  ///< that can be mixed
  std::vector<std::string> notes, left_out;
  std::vector<Table> tables;
};

enum class ViewStage { kReading, kSolvingLight, kMarching, kSampling, kCleaning, kDone };

/// How far what is being computed has come.
struct ViewProgress {
  uint64_t id = 0;
  ViewStage stage = ViewStage::kDone;
  int samples = 0;                   ///< per pixel, taken on average so far
  int goal = 0;                      ///< samples per pixel at the end of the round
  std::optional<double> share = {};  ///< of the stage that is done, where it is known
  std::optional<double> error = {};
  double seconds = 0;  ///< since it was asked for
};

/// What is wrong, and where another grid would mend it, which there are.
struct ViewProblem {
  uint64_t id = 0;
  std::string text;
  std::string grid_key = {};  ///< to assign one of the grids to
  std::vector<GridChoice> grids = {};
  bool lasting = false;  ///< over with a scene that was read again, not by another look
};

/// Told of everything that a viewer makes, from its thread or from look(); must not throw, nor call the viewer.
class ViewListener {
 public:
  virtual ~ViewListener() = default;
  virtual void scene(const ViewSceneText& scene) = 0;
  virtual void picture(ViewPicture picture) = 0;
  virtual void progress(const ViewProgress& progress) = 0;
  /// It is over with a later look, or when the scene has been read again.
  virtual void problem(const ViewProblem& problem) = 0;
  virtual void point(uint64_t id, std::optional<dvec3> position) = 0;
};

struct ViewOptions {
  std::filesystem::path scene;  ///< scene or OpenVDB file; a pattern where there are frames
  std::vector<int> frames;
  std::vector<std::string> overrides;
  std::string clean_filter = "transport_regression";
};

/// For those who can tell their user at once what a page would only show. @throws InputError: a file that is missing; a
/// scene that cannot be read, overrides included
void check_viewable(const ViewOptions& options);

/// Answers looks at a scene, the newest first: at once with a noise-free picture of predicted light (render/guides), a
/// coarse one where the whole takes long, which is refined in steps; at rest with path-traced samples in rounds, each
/// cleaned. A thread of its own does all of it.
class Viewer {
 public:
  /// @throws InputError: a filter that cannot clean renders
  Viewer(const ViewOptions& options, const Host& host, ViewListener& listener);
  ~Viewer();
  Viewer(Viewer&&) = delete;

  /// Takes the place of all looks before. One that asks for other layers or another mix alone is answered with those of
  /// the picture that is there, and what is being computed goes on.
  void look(ViewLook look);
  void probe(const ViewProbe& probe);
  /// Ends what is being computed; the next look goes on.
  void pause();
  /// Looks again if the scene's file, or one that it names, has changed; tells where one is gone. To be called now and
  /// then: files other than the scene's are read once they have not changed between two calls.
  void check_files();

  /// The last frame that was path traced and cleaned, with all layers; null before.
  std::shared_ptr<const Layers> frame() const;
  /// The best frame of this very look, whichever its layers: path traced and cleaned, or the whole predicted picture
  /// with its guides; mixed without what is not known by light group; null where neither is there yet.
  /// @throws InputError for a light group that the scene does not have
  std::shared_ptr<const Layers> frame(const ViewLook& look) const;
  /// The scene as it was looked at last, as a file of its own; empty before.
  std::string scene_text() const;
  /// The same of a look that need not have been answered. @throws InputError: as edited_scene; nothing has been read
  /// yet
  std::string scene_text(const ViewLook& look) const;
  /// What renders the look in full quality, for a shell.
  std::string command(const ViewLook& look) const;
  /// What makes the lights of the look's scene as it mixes them. @throws InputError: as assignments_of_mix; nothing has
  /// been read yet
  std::vector<std::string> mix_assignments(const ViewLook& look) const;

 private:
  class Emerging;
  struct WatchedFile {
    std::filesystem::path path;
    std::optional<std::filesystem::file_time_type> written;  // as it was read; nothing: it was not there

    static WatchedFile as_it_is(const std::filesystem::path& path);
    friend bool operator==(const WatchedFile&, const WatchedFile&) = default;
  };
  /// What looks are answered with.
  struct Kept {
    std::shared_ptr<const Layers> frame;
    ViewLook look;
    ViewPicture about;
  };

  void run();
  void answer(const ViewLook& look);
  /// @param reads  its files, too
  /// @return whether anything but camera and film changed   @throws InputError
  bool update_scene(const ViewLook& look, bool reads, const Task& task);
  void answer(const ViewProbe& probe);
  /// @return false where a newer look came while it waited
  bool rests();
  void tell_scene(const ViewLook& look, bool reloaded);
  /// Columns and rows of a picture of the look's shape that is marched in so many seconds, at most the look's own.
  ivec2 size_for(const ViewLook& look, double seconds) const;
  /// Marches the whole picture at a size and shows it.
  void march(const ViewLook& look, const Guides& guides, const ivec2& size, const Task& task);
  /// Path traces a coarse picture and shows it as it is: of scenes in which nothing is predicted.
  void trace_coarse(const ViewLook& look, const Task& task);
  /// From the picture that is there to the whole predicted one, in steps.
  void refine(const ViewLook& look, const Task& task);
  void march_whole(const ViewLook& look, const Guides& guides, const Task& task);
  void trace(const ViewLook& look, const Task& task);
  void show(const ViewLook& look, const ViewPicture& about, const Layers& frame);
  void show(const ViewLook& look, const Kept& kept) { show(look, kept.about, *kept.frame); }
  void store(Kept& kept, std::shared_ptr<const Layers> frame, const ViewLook& look, const ViewPicture& about);
  /// Keeps a frame of the look, and shows it.
  void keep(Kept& kept, std::shared_ptr<const Layers> frame, const ViewLook& look, const ViewPicture& about);
  /// With what is known of the scene that is shown; without a layer.
  ViewPicture about(bool predicted, int samples, std::optional<double> error) const;
  ViewLook current() const;
  void tell(ViewProgress progress);
  void tell(ViewStage stage) { tell({.stage = stage}); }
  /// A task whose progress is told.
  Task told(ViewStage stage, const Task& task);

  const ViewOptions options_;
  const Host host_;
  ViewListener& listener_;
  LayerRequest layers_;
  ViewedScene scene_;                  // of the thread alone, but for probes
  mutable std::mutex scene_mutex_;     // while it changes, or is looked at by a probe
  double sketched_ = 0, marched_ = 0;  // pixels a second, of the scene that is shown; 0: not measured
  std::vector<ViewSceneText::Layer> guide_layers_, told_layers_;  // once guides have been marched
  Stopwatch asked_, since_told_;
  uint64_t revision_ = 0;  // that was read

  mutable std::mutex mutex_;
  std::condition_variable woken_;
  std::optional<ViewLook> next_, last_;
  std::optional<ViewProbe> next_probe_;
  bool end_ = false, reload_ = false;
  bool resting_ = false, paused_ = false;  // last_ is being answered, and the scene is its own
  Kept traced_, predicted_;
  std::shared_ptr<const ViewedText> text_;
  ViewSceneText told_scene_;
  ViewProgress told_progress_;
  std::vector<WatchedFile> files_;  // the scene's first
  std::vector<WatchedFile> seen_;   // by the last check
  bool missing_ = false;            // that one is gone has been told
  std::atomic<bool> cancel_{false};
  std::thread thread_;
};

}  // namespace brume
