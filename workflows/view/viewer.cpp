#include "workflows/view/viewer.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <tuple>
#include <utility>

#include "base/error.h"
#include "image/light_layers.h"
#include "image/packed_half.h"
#include "image/usable_colors.h"
#include "render/scene/light_groups.h"
#include "workflows/view/scene_text.h"
#include "workflows/view/seen_depth.h"
#include "workflows/view/viewed_layers.h"

namespace brume {
namespace {

using namespace std::chrono_literals;

constexpr auto kRest = 150ms;  // without a look, after which a moving picture is at rest

}  // namespace

Viewer::Viewer(const ViewOptions& options, const Host& host, ViewListener& listener)
    : options_(options),
      host_{host.threads, &cancel_, {}, {}, {}},
      listener_(listener),
      layers_([&] {
        LayerRequest wanted;
        wanted.names = {};
        wanted.guides = true;
        return Cleaner(options.clean_filter, 1, host_).request(wanted, kFirstRound);
      }()),
      scene_(options.scene, options.frames, options.overrides, layers_) {
  thread_ = std::thread([this] { run(); });
}

Viewer::~Viewer() {
  {
    const std::lock_guard lock(mutex_);
    end_ = true;
    cancel_ = true;
  }
  woken_.notify_all();
  thread_.join();
}

void Viewer::look(ViewLook look) {
  const std::lock_guard lock(mutex_);
  paused_ = false;
  if (resting_ && !next_ && !look.moving && look.shows_as(*last_)) {
    try {
      check_light_groups(look.mix, told_scene_.light_groups, "the scene");
    } catch (const InputError& error) {
      return listener_.problem({look.id, error.what()});
    }
    last_ = std::move(look);
    if (last_->needs_scene) {
      told_scene_.id = last_->id;
      told_scene_.reloaded = false;
      listener_.scene(told_scene_);
    }
    if (traced_.frame)
      show(*last_, traced_);
    else if (predicted_.frame)
      show(*last_, predicted_);
    told_progress_.id = last_->id;
    listener_.progress(told_progress_);
    return;
  }
  next_ = std::move(look);
  cancel_ = true;
  woken_.notify_all();
}

void Viewer::probe(const ViewProbe& probe) {
  {
    const std::unique_lock lock(scene_mutex_, std::try_to_lock);
    if (lock) return answer(probe);
  }
  const std::lock_guard lock(mutex_);
  next_probe_ = probe;
  woken_.notify_all();
}

void Viewer::pause() {
  const std::lock_guard lock(mutex_);
  next_.reset();
  resting_ = false;
  paused_ = true;
  cancel_ = true;
}

Viewer::WatchedFile Viewer::WatchedFile::as_it_is(const std::filesystem::path& path) {
  std::error_code error;
  const auto written = std::filesystem::last_write_time(path, error);
  return {path, error ? std::nullopt : std::optional(written)};
}

void Viewer::check_files() {
  const std::lock_guard lock(mutex_);
  if (next_ || !last_ || files_.empty() || paused_) return;
  std::vector<WatchedFile> now;
  for (const WatchedFile& file : files_) now.push_back(WatchedFile::as_it_is(file.path));
  const bool steady = now == seen_;
  seen_ = now;
  const WatchedFile* gone = nullptr;
  for (size_t i = 0; i < now.size() && !gone; ++i)
    if (!now[i].written && files_[i].written) gone = &now[i];
  const bool scene_changed = now[0].written && now[0].written != files_[0].written;
  if (gone && !scene_changed) {
    // Whoever writes a file anew may take the old one away first.
    if (!steady || missing_) return;
    missing_ = true;
    ViewProblem problem{last_->id,
                        fmt::format("{}: the file is gone. The last picture stays; the file is read again as "
                                    "soon as it is back",
                                    gone->path.string())};
    problem.lasting = true;
    listener_.problem(problem);
    return;
  }
  if (!scene_changed && !missing_ && !(now != files_ && steady)) return;
  missing_ = false;
  reload_ = true;
  next_ = last_;
  cancel_ = true;
  woken_.notify_all();
}

std::shared_ptr<const Layers> Viewer::frame() const {
  const std::lock_guard lock(mutex_);
  return traced_.frame;
}

std::shared_ptr<const Layers> Viewer::frame(const ViewLook& look) const {
  std::shared_ptr<const Layers> kept;
  bool predicted = false;
  {
    const std::lock_guard lock(mutex_);
    if (traced_.frame && traced_.look.shows_as(look)) {
      kept = traced_.frame;
    } else if (predicted_.frame && predicted_.about.full && predicted_.look.shows_as(look)) {
      kept = predicted_.frame;
      predicted = true;
    }
    if (kept) check_light_groups(look.mix, told_scene_.light_groups, "the scene");
  }
  if (!kept || (!predicted && look.mix.empty())) return kept;
  if (!predicted) {
    const std::vector<std::string> groups = light_groups_in(*kept);
    const bool clean = std::all_of(groups.begin(), groups.end(), [&](const std::string& group) {
      return kept->find(clean_light_layer(group) + ".R") != nullptr;
    });
    return clean ? std::make_shared<const Layers>(mix_lights(*kept, look.mix)) : nullptr;
  }
  const ViewedLayer picture(*kept, kViewedPicture, /*predicted=*/true, look.mix);
  if (picture.empty() || picture.misses_mix()) return nullptr;
  // Guides are of the light as it was.
  auto frame = std::make_shared<Layers>(look.mix.empty() ? *kept : kept->without_channels());
  for (size_t c = 0; c < 3; ++c) frame->set(std::string(1, "RGB"[c]), picture.plane(*kept, c));
  if (!look.mix.empty()) frame->header["lightMix"] = text_of_mix(look.mix);
  return frame;
}

std::string Viewer::scene_text() const {
  ViewLook look;
  {
    const std::lock_guard lock(mutex_);
    if (!text_ || !last_) return "";
    look = *last_;
  }
  return scene_text(look);
}

std::string Viewer::scene_text(const ViewLook& look) const {
  std::shared_ptr<const ViewedText> text;
  {
    const std::lock_guard lock(mutex_);
    text = text_;
  }
  if (!text) throw InputError(fmt::format("{}: has not been read yet", options_.scene.string()));
  return text->scene(text->mixed(look.assignments, look.size, look.frame, look.mix), look.size, look.frame);
}

std::string Viewer::command(const ViewLook& look) const {
  std::shared_ptr<const ViewedText> text;
  {
    const std::lock_guard lock(mutex_);
    text = text_;
  }
  if (!text) text = std::make_shared<ViewedText>(ViewedText{options_.scene, options_.frames, options_.overrides});
  return text->command(text->mixed(look.assignments, look.size, look.frame, look.mix), look.size, look.frame);
}

std::vector<std::string> Viewer::mix_assignments(const ViewLook& look) const {
  std::shared_ptr<const ViewedText> text;
  {
    const std::lock_guard lock(mutex_);
    text = text_;
  }
  if (!text) throw InputError(fmt::format("{}: has not been read yet", options_.scene.string()));
  return assignments_of_mix(text->scene(look.assignments, look.size, look.frame), text->path, look.mix);
}

void Viewer::run() {
  for (;;) {
    std::optional<ViewLook> look;
    std::optional<ViewProbe> probe;
    {
      std::unique_lock lock(mutex_);
      woken_.wait(lock, [&] { return end_ || next_ || next_probe_; });
      if (end_) return;
      cancel_ = false;
      resting_ = false;
      probe = std::exchange(next_probe_, std::nullopt);
      look = std::exchange(next_, std::nullopt);
      if (look) last_ = look;
    }
    const uint64_t id = look ? look->id : probe->id;
    try {
      if (probe) answer(*probe);
      if (look) answer(*look);
    } catch (const Interrupted&) {  // by what comes next
    } catch (const std::exception& error) {
      ViewProblem problem{id, error.what()};
      if (look) std::tie(problem.grid_key, problem.grids) = scene_.grids_instead();
      listener_.problem(problem);
    }
    const std::lock_guard lock(mutex_);
    resting_ = resting_ && traced_.frame;  // all samples are taken
  }
}

bool Viewer::rests() {
  std::unique_lock lock(mutex_);
  return !woken_.wait_for(lock, kRest, [&] { return end_ || next_ || next_probe_; });
}

void Viewer::answer(const ViewProbe& probe) {
  std::optional<dvec3> position;
  if (!scene_.empty()) {
    const PreparedScene& prepared = scene_.prepared();
    const Camera camera = prepared.camera();
    const Ray ray = camera.ray(probe.at * dvec2(camera.film_size()));
    if (const std::optional<double> t = seen_depth(prepared.context(), ray))
      position = ray.o + *t * ray.d + prepared.world_shift();
  }
  listener_.point(probe.id, position);
}

bool Viewer::update_scene(const ViewLook& look, bool reads, const Task& task) {
  // As they were before they are read: what happens to them meanwhile is a change.
  std::vector<WatchedFile> known;
  if (reads)
    for (const std::filesystem::path& path : scene_.files()) known.push_back(WatchedFile::as_it_is(path));
  const auto watch_files = [&] {
    const std::lock_guard lock(mutex_);
    if (!reads) known = files_;
    std::vector<WatchedFile> files;
    for (const std::filesystem::path& path : scene_.files()) {
      const auto same = [&](const WatchedFile& file) { return file.path == path && file.written; };
      const auto found = std::find_if(known.begin(), known.end(), same);
      files.push_back(found != known.end() ? *found : WatchedFile::as_it_is(path));
    }
    files_ = std::move(files);
  };
  try {
    bool changed = false;
    {
      const std::lock_guard lock(scene_mutex_);
      changed = scene_.show(look.assignments, look.size, look.frame, task);
    }
    watch_files();
    const std::lock_guard lock(mutex_);
    text_ = std::make_shared<const ViewedText>(scene_.source());
    return changed;
  } catch (const Interrupted&) {
    throw;
  } catch (...) {
    watch_files();  // a file that is wrong is looked at again when it changes
    throw;
  }
}

void Viewer::answer(const ViewLook& look) {
  asked_ = Stopwatch();
  bool reloaded = false;
  {
    const std::lock_guard lock(mutex_);
    reloaded = std::exchange(reload_, false);
    // What was seen before is no picture of this look.
    for (Kept* const kept : {&traced_, &predicted_})
      if (reloaded || !kept->look.shows_as(look)) kept->frame.reset();
  }
  if (reloaded) {
    scene_.read_again();
    pace_.forget();
  }
  // A look that is on its way is not given up for the next one: under a moving mouse none would ever be answered.
  const Task whole{host_.threads, {}, nullptr}, until_next{host_.threads, {}, &cancel_};
  if (const bool revised = std::exchange(revision_, look.revision) != look.revision; revised && !scene_.empty()) {
    scene_.read_text_again();
    const std::lock_guard lock(mutex_);
    if (!files_.empty()) files_[0] = WatchedFile::as_it_is(files_[0].path);
  }
  const bool reads = scene_.empty() || reloaded;
  if (reads) tell(ViewStage::kReading);
  const bool changed = update_scene(look, reads, reads ? told(ViewStage::kReading, whole) : whole);
  if (!look.moving || reloaded || look.needs_scene) tell_scene(look, reloaded);
  check_light_groups(look.mix, light_groups_of(scene_.prepared().scene()).names, "the scene");
  const bool predicts = scene_.prepared().medium() || !scene_.prepared().context().emissions.empty();
  if (predicts) {
    if (changed) {
      pace_.forget_whole();
      tell(ViewStage::kSolvingLight);
    }
    if (look.moving || !scene_.has_guides() || pace_.is_slow(look.size))
      march(look, scene_.sketch(told(ViewStage::kSolvingLight, whole)), pace_.size_within(kMovingSeconds, look.size),
            whole);
  }
  if (look.moving) {
    if (!predicts) trace_coarse(look, whole);
    if (!rests()) return;
    tell_scene(look, false);
  }
  {
    const std::lock_guard lock(mutex_);
    resting_ = !next_;
  }
  if (predicts) refine(look, until_next);
  if (guide_layers_ != told_layers_) tell_scene(current(), false);
  trace(look, until_next);
}

void Viewer::store(Kept& kept, std::shared_ptr<const Layers> frame, const ViewLook& look, const ViewPicture& about) {
  const std::lock_guard lock(mutex_);
  kept = {std::move(frame), look, about};
}

void Viewer::keep(Kept& kept, std::shared_ptr<const Layers> frame, const ViewLook& look, const ViewPicture& about) {
  store(kept, frame, look, about);
  show(current(), about, *frame);
}

ViewLook Viewer::current() const {
  const std::lock_guard lock(mutex_);
  return *last_;
}

ViewPicture Viewer::about(bool predicted, int samples, std::optional<double> error) const {
  ViewPicture picture;
  picture.predicted = predicted;
  picture.samples = samples;
  picture.error = error;
  picture.seconds = asked_.seconds();
  picture.exposure = scene_.prepared().scene().film.exposure;
  picture.frame = scene_.frame();
  return picture;
}

void Viewer::show(const ViewLook& look, const ViewPicture& about, const Layers& frame) {
  for (const std::string& layer : look.layers) {
    const ViewedLayer viewed(frame, layer, about.predicted, look.mix);
    if (viewed.empty()) continue;
    ViewPicture picture = about;
    picture.id = look.id;
    picture.layer = layer;
    picture.width = frame.width();
    picture.height = frame.height();
    picture.channels = static_cast<int>(viewed.channel_count());
    picture.misses_mix = viewed.misses_mix();
    Layers shown(frame.width(), frame.height());
    describe_colors(shown, scene_.prepared().scene().film);
    for (size_t c = 0; c < viewed.channel_count(); ++c) shown.set(viewed.channels()[c], viewed.plane(frame, c));
    convert_to_rec709(shown, layer);
    for (const std::string& channel : viewed.channels()) {
      const std::vector<uint16_t> halves = half_bits(shown.at(channel));
      picture.halves.insert(picture.halves.end(), halves.begin(), halves.end());
    }
    listener_.picture(std::move(picture));
  }
}

void Viewer::tell(ViewProgress progress) {
  progress.seconds = asked_.seconds();
  since_told_ = Stopwatch();
  {
    const std::lock_guard lock(mutex_);
    progress.id = last_->id;
    told_progress_ = progress;
  }
  listener_.progress(progress);
}

Task Viewer::told(ViewStage stage, const Task& task) {
  return {task.threads,
          [this, stage](double share) {
            if (since_told_.seconds() >= kTellEvery) tell({.stage = stage, .share = share});
          },
          task.cancel};
}

void Viewer::tell_scene(const ViewLook& look, bool reloaded) {
  ViewSceneText text = scene_text_of(scene_, guide_layers_);
  told_layers_ = guide_layers_;
  text.id = look.id;
  text.command = command(look);
  text.reloaded = reloaded;
  listener_.scene(text);
  const std::lock_guard lock(mutex_);
  told_scene_ = std::move(text);
}

}  // namespace brume
