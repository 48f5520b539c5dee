#pragma once
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "base/progress.h"
#include "workflows/view/view_source.h"
#include "workflows/view/viewed_frame.h"

namespace brume {

/// Answers looks at frames that are there: their layers, and their light groups mixed. Nothing is rendered.
class FrameViewer : public ViewSource {
 public:
  FrameViewer(const ViewOptions& options, const Host& host, ViewListener& listener);
  ~FrameViewer() override;
  FrameViewer(FrameViewer&&) = delete;

  void look(ViewLook look) override;
  /// Where the points of a picture lie is not known.
  void probe(const ViewProbe& probe) override { listener_.point(probe.id, std::nullopt); }
  void pause() override;
  void check_files() override;
  std::shared_ptr<const Layers> frame() const override;
  std::shared_ptr<const Layers> frame(const ViewLook& look) const override;
  std::string scene_text() const override;
  std::string scene_text(const ViewLook& look) const override;
  std::string command(const ViewLook& look) const override;
  std::vector<std::string> mix_assignments(const ViewLook& look) const override;

 private:
  using FileTime = std::optional<std::filesystem::file_time_type>;  // nothing: there is no file

  void run();
  void answer(const ViewLook& look);
  /// Opens the look's file unless it is open as it lies there. @return whether it did   @throws InputError
  bool open(const std::filesystem::path& path);
  void tell_frame(const ViewLook& look, bool reloaded);
  std::filesystem::path file_of(const ViewLook& look) const;
  static FileTime written(const std::filesystem::path& path);

  const ViewOptions options_;
  const Host host_;
  ViewListener& listener_;
  std::optional<ViewedFrame> frame_;  // of the thread alone, as is what is told
  std::filesystem::path path_;
  std::vector<ViewSceneText::Layer> told_layers_;

  mutable std::mutex mutex_;
  std::condition_variable woken_;
  std::optional<ViewLook> next_, last_;
  FileTime written_, seen_;  // of the file that is open: as it was read, and by the last check
  bool end_ = false, reload_ = false, missing_ = false;
  std::thread thread_;
};

}  // namespace brume
