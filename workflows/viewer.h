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
  bool needs_scene = false;  ///< who looks has been told nothing of the scene yet

  bool differs_in_layers_alone(const ViewLook& other) const {
    return assignments == other.assignments && size == other.size && frame == other.frame && !moving && !needs_scene;
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
  bool predicted = false;  ///< from guides alone; else path traced and clean
  bool full = true;        ///< of the size asked for
  int samples = 0;         ///< per pixel, at least
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
  std::vector<std::string> notes, left_out;
  std::vector<Table> tables;
};

enum class ViewStage { kReading, kSolvingLight, kMarching, kSampling, kDone };

/// Told of everything that a viewer makes, from its thread or from look(); must not throw, nor call the viewer.
class ViewListener {
 public:
  virtual ~ViewListener() = default;
  virtual void scene(const ViewSceneText& scene) = 0;
  virtual void picture(ViewPicture picture) = 0;
  virtual void progress(uint64_t id, ViewStage stage, int samples, std::optional<double> error, double seconds) = 0;
  virtual void problem(uint64_t id, const std::string& text) = 0;
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

/// Answers looks at a scene, the newest first: at once with a noise-free picture of predicted light (render/guides), at
/// rest with path-traced samples in rounds, each cleaned. A thread of its own does all of it.
class Viewer {
 public:
  /// @throws InputError: a filter that cannot clean renders
  Viewer(const ViewOptions& options, const Host& host, ViewListener& listener);
  ~Viewer();
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;

  /// Takes the place of all looks before. One that asks for other layers alone is answered with those of the last
  /// clean picture, and samples go on.
  void look(ViewLook look);
  void probe(const ViewProbe& probe);
  /// Ends what is being computed; the next look goes on.
  void pause();
  /// Looks again if the scene's file has changed.
  void check_file();

  /// The last frame that was path traced and cleaned, with all layers; null before.
  std::shared_ptr<const Layers> frame() const;
  /// The scene as it is shown, as a file of its own; empty before.
  std::string scene_text() const;

 private:
  void run();
  void answer(const ViewLook& look);
  /// @return whether anything but camera and film changed   @throws InputError
  bool update_scene(const ViewLook& look, const Task& task);
  void answer(const ViewProbe& probe);
  /// @return false where a newer look came while it waited
  bool rests();
  void tell_scene(const ViewLook& look, bool reloaded);
  void predict(const ViewLook& look, const Guides& guides, const ivec2& size, const Task& task);
  void trace(const ViewLook& look, const Task& task);
  void show(const ViewLook& look, const ViewPicture& about, const Layers& frame);
  /// With what is known of the scene that is shown; without a layer.
  ViewPicture about(bool predicted, int samples, std::optional<double> error) const;
  ViewLook current() const;
  void tell(const ViewLook& look, ViewStage stage, int samples = 0, std::optional<double> error = {});

  const ViewOptions options_;
  const Host host_;
  ViewListener& listener_;
  LayerRequest layers_;
  ViewedScene scene_;  // of the thread alone
  double pixels_a_second_;
  std::vector<ViewSceneText::Layer> guide_layers_;  // once guides have been marched
  Stopwatch asked_;

  mutable std::mutex mutex_;
  std::condition_variable woken_;
  std::optional<ViewLook> next_, last_;
  std::optional<ViewProbe> next_probe_;
  bool end_ = false, reload_ = false;
  bool tracing_ = false, paused_ = false;
  std::shared_ptr<const Layers> frame_;
  ViewPicture about_frame_;
  std::string scene_text_;
  std::filesystem::path file_;  // of the scene, as it was read
  std::filesystem::file_time_type written_;
  std::atomic<bool> cancel_{false};
  std::thread thread_;
};

}  // namespace brume
