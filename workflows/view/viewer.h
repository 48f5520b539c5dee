#pragma once
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
#include "workflows/clean.h"
#include "workflows/host.h"
#include "workflows/view/march_pace.h"
#include "workflows/view/messages.h"
#include "workflows/view/view_source.h"
#include "workflows/view/viewed_scene.h"

namespace brume {

/// Answers looks at a scene, the newest first: at once with a noise-free picture of predicted light (render/guides), a
/// coarse one where the whole takes long, which is refined in steps; at rest with path-traced samples in rounds, each
/// cleaned. A thread of its own does all of it.
class Viewer : public ViewSource {
 public:
  /// @throws InputError: a filter that cannot clean renders
  Viewer(const ViewOptions& options, const Host& host, ViewListener& listener);
  ~Viewer() override;
  Viewer(Viewer&&) = delete;

  /// Takes the place of all looks before. One that asks for other layers or another mix alone is answered with those of
  /// the picture that is there, and what is being computed goes on.
  void look(ViewLook look) override;
  void probe(const ViewProbe& probe) override;
  /// Ends what is being computed; the next look goes on.
  void pause() override;
  /// Looks again if the scene's file, or one that it names, has changed; tells where one is gone. To be called now and
  /// then: files other than the scene's are read once they have not changed between two calls.
  void check_files() override;

  /// The last frame that was path traced and cleaned, with all layers; null before.
  std::shared_ptr<const Layers> frame() const override;
  /// The best frame of this very look, whichever its layers: path traced and cleaned, or the whole predicted picture
  /// with its guides; mixed without what is not known by light group; null where neither is there yet.
  /// @throws InputError for a light group that the scene does not have
  std::shared_ptr<const Layers> frame(const ViewLook& look) const override;
  /// The scene as it was looked at last, as a file of its own; empty before.
  std::string scene_text() const override;
  /// The same of a look that need not have been answered. @throws InputError: as edited_scene; nothing has been read
  /// yet
  std::string scene_text(const ViewLook& look) const override;
  /// What renders the look in full quality, for a shell.
  std::string command(const ViewLook& look) const override;
  /// What makes the lights of the look's scene as it mixes them. @throws InputError: as assignments_of_mix; nothing has
  /// been read yet
  std::vector<std::string> mix_assignments(const ViewLook& look) const override;

 private:
  static constexpr double kMovingSeconds = 0.06;  // that the march of a moving picture may take
  static constexpr double kTellEvery = 0.1;       // s between words about progress
  static constexpr int kFirstRound = 8;           // samples a pixel
  static constexpr int kGuideSamples = ViewedScene::kGuideSamples;

  class Emerging;
  class Tracing;
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
  ViewedScene scene_;                                             // of the thread alone, but for probes
  mutable std::mutex scene_mutex_;                                // while it changes, or is looked at by a probe
  MarchPace pace_;                                                // of the scene that is shown
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
