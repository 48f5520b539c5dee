#include "workflows/view/frame_viewer.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <utility>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "workflows/frame.h"
#include "workflows/mix_text.h"

namespace brume {

FrameViewer::FrameViewer(const ViewOptions& options, const Host& host, ViewListener& listener)
    : options_(options), host_(host), listener_(listener) {
  thread_ = std::thread([this] { run(); });
}

FrameViewer::~FrameViewer() {
  {
    const std::lock_guard lock(mutex_);
    end_ = true;
  }
  woken_.notify_all();
  thread_.join();
}

void FrameViewer::look(ViewLook look) {
  const std::lock_guard lock(mutex_);
  next_ = std::move(look);
  woken_.notify_all();
}

void FrameViewer::pause() {
  const std::lock_guard lock(mutex_);
  next_.reset();
}

FrameViewer::FileTime FrameViewer::written(const std::filesystem::path& path) {
  std::error_code error;
  const auto time = std::filesystem::last_write_time(path, error);
  return error ? std::nullopt : FileTime(time);
}

void FrameViewer::check_files() {
  const std::lock_guard lock(mutex_);
  if (next_ || !last_) return;
  const std::filesystem::path path = file_of(*last_);
  const FileTime now = written(path);
  const bool steady = std::exchange(seen_, now) == now;
  if ((now == written_ && !missing_) || !steady) return;
  if (now) {
    missing_ = false;
    reload_ = true;
    next_ = last_;
    woken_.notify_all();
  } else if (!missing_) {
    missing_ = true;
    ViewProblem problem{last_->id, fmt::format("{}: the file is gone. The last picture stays; it is read again as soon "
                                               "as it is back",
                                               path.string())};
    problem.lasting = true;
    listener_.problem(problem);
  }
}

std::filesystem::path FrameViewer::file_of(const ViewLook& look) const {
  if (options_.frames.empty()) return options_.scene;
  return file_of_frame(options_.scene, look.frame.value_or(options_.frames.front()));
}

void FrameViewer::run() {
  for (;;) {
    ViewLook look;
    {
      std::unique_lock lock(mutex_);
      woken_.wait(lock, [&] { return end_ || next_; });
      if (end_) return;
      look = *std::exchange(next_, std::nullopt);
      last_ = look;
    }
    try {
      answer(look);
    } catch (const std::exception& error) {
      listener_.problem({look.id, error.what()});
    }
  }
}

bool FrameViewer::open(const std::filesystem::path& path) {
  const FileTime now = written(path);
  {
    const std::lock_guard lock(mutex_);
    if (frame_ && path == path_ && now == written_) return false;
    missing_ = false;
    written_ = seen_ = now;  // one that is wrong is read again when it changes
  }
  frame_.reset();
  check_exists(path);
  path_ = path;
  frame_.emplace(path, options_.map);
  return true;
}

void FrameViewer::answer(const ViewLook& look) {
  const Stopwatch watch;
  const bool reloaded = [&] {
    const std::lock_guard lock(mutex_);
    return std::exchange(reload_, false);
  }();
  const bool opened = open(file_of(look));
  if (opened) listener_.progress({.id = look.id, .stage = ViewStage::kReading, .seconds = watch.seconds()});
  if (look.needs_scene || reloaded || (opened && (!look.moving || told_layers_ != frame_->layers())))
    tell_frame(look, reloaded);
  check_light_groups(look.mix, frame_->light_groups(), "the frame");
  for (const std::string& layer : look.layers) {
    std::optional<ViewPicture> picture = frame_->picture(layer, look.mix, look.size);
    if (!picture) continue;
    picture->id = look.id;
    picture->seconds = watch.seconds();
    if (!options_.frames.empty()) picture->frame = look.frame.value_or(options_.frames.front());
    listener_.picture(std::move(*picture));
  }
  listener_.progress({.id = look.id, .stage = ViewStage::kDone, .seconds = watch.seconds()});
}

void FrameViewer::tell_frame(const ViewLook& look, bool reloaded) {
  ViewSceneText text;
  text.id = look.id;
  text.name = options_.scene.stem().string();
  text.of_frames = true;
  text.command = command(look);
  text.reloaded = reloaded;
  text.frames = options_.frames;
  text.layers = told_layers_ = frame_->layers();
  text.light_groups = frame_->light_groups();
  text.notes = frame_->notes();
  listener_.scene(text);
}

std::shared_ptr<const Layers> FrameViewer::frame() const {
  std::optional<ViewLook> look;
  {
    const std::lock_guard lock(mutex_);
    look = last_;
  }
  return look ? frame(*look) : nullptr;
}

std::shared_ptr<const Layers> FrameViewer::frame(const ViewLook& look) const {
  const ExrFile file(file_of(look));
  return std::make_shared<const Layers>(look.mix.empty() ? read_frame(file, host_)
                                                         : mixed_frame(file, options_.map, look.mix, host_));
}

std::string FrameViewer::scene_text() const {
  std::optional<ViewLook> look;
  {
    const std::lock_guard lock(mutex_);
    look = last_;
  }
  return look ? scene_text(*look) : "";
}

std::string FrameViewer::scene_text(const ViewLook& look) const {
  const ExrFile file(file_of(look));
  const std::vector<FrameLights> lights = lights_in(file.info(), picture_in(file.info(), options_.map));
  check_light_groups(look.mix, lights.empty() ? std::vector<std::string>() : lights[0].names(), "the frame");
  return toml_of_mix(look.mix);
}

std::string FrameViewer::command(const ViewLook& look) const {
  const std::filesystem::path file = file_of(look);
  std::vector<std::string> words = {"brume", look.mix.empty() ? "picture" : "mix", file.string()};
  if (!look.mix.empty()) {
    for (std::string& word : words_of_mix(look.mix)) words.push_back(std::move(word));
    if (!options_.map.empty()) words.insert(words.end(), {"--map", options_.map.string()});
  }
  words.insert(words.end(), {"-o", file.stem().string() + (look.mix.empty() ? ".png" : "_mix.exr")});
  std::string line;
  for (const std::string& word : words) line += (line.empty() ? "" : " ") + shell_word(word);
  return line;
}

std::vector<std::string> FrameViewer::mix_assignments(const ViewLook& look) const {
  throw InputError(fmt::format(
      "{}: a frame has no lights to change; its mix goes into the scene that it is of by brume mix --scene --save-scene",
      file_of(look).string()));
}

}  // namespace brume
