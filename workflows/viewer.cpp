#include "workflows/viewer.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "base/error.h"
#include "base/sequence.h"
#include "image/guide_names.h"
#include "image/light_layers.h"
#include "image/packed_half.h"
#include "image/usable_colors.h"
#include "render/scene/light_groups.h"
#include "render/scene/scene_io.h"
#include "volume/tracking.h"
#include "workflows/scene.h"
#include "workflows/version.h"
#include "workflows/viewed_layers.h"

namespace brume {
namespace {

using namespace std::chrono_literals;

constexpr auto kRest = 150ms;            // without a look, after which a moving picture is at rest
constexpr double kMovingSeconds = 0.06;  // that the march of a moving picture may take
constexpr double kAtOnce = 0.2;          // s: what takes longer is shown coarse before
constexpr int kCoarseSamples = 4;        // per pixel of a coarse picture that is path traced
constexpr double kFewestPixels = 6000;   // of a coarse picture, where they are marched within kAtOnce
constexpr double kLeastPixels = 1500;    // where not
constexpr double kFirstPace = 1e5;       // pixels a second of a coarse picture, until one has been measured
constexpr double kSlower = 10;           // a pixel of the whole picture over one of a coarse one, likewise
constexpr double kStepsFrom = 1;         // s: whole pictures that take longer come in steps
constexpr double kStepShare = 0.3;       // of the time that the whole picture takes, at most for a step
constexpr double kStepGrowth = 1.4;      // of the sides, at least from step to step
constexpr double kShowEvery = 0.7;       // s between pictures on their way
constexpr double kShowShare = 0.1;       // of the time, at most for showing them
constexpr double kTellEvery = 0.1;       // s between words about progress
constexpr int kFirstRound = 8;           // samples a pixel
constexpr int kGuideSamples = ViewedScene::kGuideSamples;
constexpr double kFar = 1e30;  // scene units

/// Drawn larger, bilinearly; the middles of its pixels stay where they are in the picture.
Plane enlarged(const Plane& from, int width, int height) {
  Plane to(width, height);
  struct Place {
    int low, high;
    float share;
  };
  const auto place = [](int i, int of, int in) {
    const double at = std::clamp((i + 0.5) * in / of - 0.5, 0.0, in - 1.0);
    const int low = static_cast<int>(at);
    return Place{low, std::min(low + 1, in - 1), static_cast<float>(at - low)};
  };
  std::vector<Place> columns;
  for (int x = 0; x < width; ++x) columns.push_back(place(x, width, from.width()));
  for (int y = 0; y < height; ++y) {
    const Place row = place(y, height, from.height());
    const float *const above = from.row(row.low), *const below = from.row(row.high);
    for (int x = 0; x < width; ++x) {
      const Place& c = columns[static_cast<size_t>(x)];
      const float top = above[c.low] + c.share * (above[c.high] - above[c.low]);
      const float bottom = below[c.low] + c.share * (below[c.high] - below[c.low]);
      to(x, y) = top + row.share * (bottom - top);
    }
  }
  return to;
}

/// The names of the guides in a frame.
std::vector<ViewSceneText::Layer> guides_in(const Layers& frame) {
  std::vector<ViewSceneText::Layer> layers;
  for (const auto& [channel, plane] : frame.channels()) {
    if (!is_guide(channel)) continue;
    const std::string name = channel.substr(0, channel.rfind('.'));
    if (layers.empty() || layers.back().name != name) {
      const auto [guide, meaning] = find_guide(name);
      layers.push_back(guide
                           ? ViewSceneText::Layer{name, meaning, 0, std::string(guide->list), std::string(guide->unit)}
                           : ViewSceneText::Layer{name, name, 0, "other guides", ""});
    }
    ++layers.back().channels;
  }
  std::erase_if(layers, [](const auto& layer) { return layer.channels != 1 && layer.channels != 3; });
  return layers;
}

const std::vector<ViewSceneText::Layer> kTracedLayers = {
    {kViewedPicture, "picture", 3, "", "W/(m^2 sr)"},
    {"noisy", "noisy", 3, "path traced", "W/(m^2 sr)"},
    {"clean_direct", "direct, clean", 3, "path traced", "W/(m^2 sr)"},
    {"clean_indirect", "indirect, clean", 3, "path traced", "W/(m^2 sr)"},
    {"direct", "direct, noisy", 3, "path traced", "W/(m^2 sr)"},
    {"indirect", "indirect, noisy", 3, "path traced", "W/(m^2 sr)"},
    {"clean_error", "estimated error", 1, "path traced", "W/(m^2 sr)"},
    {"sample_count", "samples", 1, "path traced", "a pixel"},
};

/// What scenes ask for that guides do not predict (docs/guides.md, limits).
std::vector<std::string> left_out_of(const Scene& scene, bool has_media) {
  std::vector<std::string> left_out;
  if (!has_media)
    left_out.emplace_back("nothing here scatters: without a medium no picture is predicted, it is path traced");
  for (const SurfaceSettings& surface : scene.surfaces) {
    if (surface.role == "shadow_catcher") left_out.emplace_back("shadow catchers");
    if (surface.material == "dielectric") left_out.emplace_back("light focused by glass");
  }
  std::sort(left_out.begin(), left_out.end());
  left_out.erase(std::unique(left_out.begin(), left_out.end()), left_out.end());
  return left_out;
}

/// Where half of what the eye sees along a ray lies, or the first surface before that.
std::optional<double> depth_seen(const PathContext& context, const Ray& ray) {
  const auto depth_to = [&](double t) {
    double sum = 0;
    for (const Medium& m : context.media)
      m.each_met(ray, t, [&](const Medium& one, size_t) { sum += optical_depth(one, one.to_local(ray), t); });
    return sum;
  };
  const std::optional<SurfaceHit> hit = context.surfaces ? context.surfaces->intersect(ray, kFar) : std::nullopt;
  double far = 0;
  for (const Medium& m : context.media) {
    const Medium::Sphere sphere = m.bounding_sphere();
    far = std::max(far, glm::distance(ray.o, sphere.centre) + sphere.radius);
  }
  if (hit) far = std::min(far, hit->t);
  const double whole = far > 0 ? depth_to(far) : 0;
  if (whole < 0.05) return hit ? std::optional(hit->t) : std::nullopt;
  const double wanted = -std::log(1 - 0.5 * (1 - std::exp(-whole)));
  double lo = 0, hi = far;
  for (int step = 0; step < 40; ++step) {
    const double middle = 0.5 * (lo + hi);
    (depth_to(middle) < wanted ? lo : hi) = middle;
  }
  return hi;
}

std::string title_of(const SceneTable& table) {
  for (const char* key : {"file", "type", "shape"})
    if (const SceneKey* const k = table.find(key))
      if (const auto* const text = std::get_if<std::string>(&k->value); text && !text->empty())
        return k->type == SceneKey::Type::kFile ? std::filesystem::path(*text).filename().string() : *text;
  return table.path;
}

bool is_enabled(const SceneTable& table) {
  const SceneKey* const key = table.find("enabled");
  return !key || std::get<bool>(key->value);
}

}  // namespace

void check_viewable(const ViewOptions& options) {
  std::error_code ignored;
  const auto there = std::find_if(options.frames.begin(), options.frames.end(), [&](int number) {
    return std::filesystem::exists(file_of_frame(options.scene, number), ignored);
  });
  const int frame = options.frames.empty() ? 0 : there == options.frames.end() ? options.frames.front() : *there;
  const std::filesystem::path file = file_of_frame(options.scene, frame);
  if (std::error_code error; !std::filesystem::exists(file, error))
    throw InputError(fmt::format("{}: no such file", file.string()));
  if (is_volume(file)) return;
  std::vector<std::string> overrides = options.overrides;
  if (!options.frames.empty()) overrides.push_back(fmt::format("render.frame={}", frame));
  read_scene_alone(file, overrides);
}

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
    if (const std::optional<double> t = depth_seen(prepared.context(), ray))
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
    sketched_ = marched_ = 0;
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
      marched_ = 0;
      tell(ViewStage::kSolvingLight);
    }
    const double pixels = 1.0 * look.size.x * look.size.y;
    if (look.moving || !scene_.has_guides() || marched_ <= 0 || pixels > kAtOnce * marched_)
      march(look, scene_.sketch(told(ViewStage::kSolvingLight, whole)), size_for(look, kMovingSeconds), whole);
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

ivec2 Viewer::size_for(const ViewLook& look, double seconds) const {
  const double pace = sketched_ > 0 ? sketched_ : kFirstPace, pixels = 1.0 * look.size.x * look.size.y;
  const double wanted = std::max({seconds * pace, std::min(kFewestPixels, kAtOnce * pace), kLeastPixels});
  const double share = std::sqrt(std::min(1.0, wanted / pixels));
  return glm::max(ivec2(glm::round(dvec2(look.size) * share)), ivec2(1));
}

void Viewer::march(const ViewLook& look, const Guides& guides, const ivec2& size, const Task& task) {
  tell(ViewStage::kMarching);
  const Stopwatch watch;
  const PreparedScene& prepared = scene_.prepared();
  auto frame = std::make_shared<Layers>(size.x, size.y);
  const Camera camera(prepared.scene().camera, size.x, size.y, prepared.world_shift());
  const double pixels = 1.0 * size.x * size.y;
  const bool sketch = size != look.size || marched_ <= 0 || pixels > kAtOnce * marched_;
  guides.record(camera, ivec2(0), *frame, task, sketch);
  (sketch ? sketched_ : marched_) = pixels / std::max(1e-3, watch.seconds());
  guide_layers_ = guides_in(*frame);
  ViewPicture known = about(/*predicted=*/true, 0, {});
  known.full = false;
  keep(predicted_, frame, look, known);
}

void Viewer::trace_coarse(const ViewLook& look, const Task& task) {
  tell(ViewStage::kSampling);
  const Stopwatch watch;
  const ivec2 size = size_for(look, kMovingSeconds);
  const Layers frame = scene_.coarse(size, kCoarseSamples, task);
  sketched_ = 1.0 * size.x * size.y / std::max(1e-3, watch.seconds());
  ViewPicture known = about(/*predicted=*/false, kCoarseSamples, {});
  known.full = false;
  show(current(), known, frame);
}

void Viewer::refine(const ViewLook& look, const Task& task) {
  ivec2 shown(0);
  {
    const std::lock_guard lock(mutex_);
    if (predicted_.frame && predicted_.about.full) return show(*last_, predicted_);  // the same look again
    if (predicted_.frame) shown = {predicted_.frame->width(), predicted_.frame->height()};
  }
  const auto larger = [&](const ivec2& size) { return size.x > kStepGrowth * shown.x; };
  const auto step = [&](const Guides& guides, const ivec2& size) {
    march(look, guides, size, task);
    shown = size;
  };
  if (!scene_.has_guides()) {
    // There is light for a coarse picture while that for a good one is solved.
    if (const ivec2 size = size_for(look, 5 * kMovingSeconds); larger(size)) step(scene_.sketch(task), size);
    tell(ViewStage::kSolvingLight);
  }
  const Guides& guides = scene_.guides(told(ViewStage::kSolvingLight, task));
  const double pixels = 1.0 * look.size.x * look.size.y;
  for (const int part : {8, 4, 2}) {
    const double pace = sketched_ > 0 ? sketched_ : kFirstPace;
    const double seconds = pixels / (marched_ > 0 ? marched_ : pace / kSlower);
    const ivec2 size = glm::max(look.size / part, ivec2(1));
    if (seconds < kStepsFrom || 1.0 * size.x * size.y > kStepShare * seconds * pace) break;
    if (larger(size)) step(guides, size);
  }
  march_whole(look, guides, task);
}

/// The whole picture while it is marched, tile by tile, over the coarse one that was there.
class Viewer::Emerging {
 public:
  Emerging(Viewer& viewer, const Layers& frame) : viewer_(viewer), frame_(frame) {
    const std::lock_guard lock(viewer.mutex_);
    coarse_ = viewer.predicted_.frame;
  }
  /// Pixels that are there. One call at a time.
  void add(const ivec2& from, const ivec2& to) {
    tiles_.push_back({from, to});
    pixels_ += static_cast<double>(to.x - from.x) * (to.y - from.y);
    if (watch_.seconds() < next_ || pixels_ >= static_cast<double>(frame_.width()) * frame_.height()) return;
    const Stopwatch showing;
    show();
    next_ = watch_.seconds() + std::max(kShowEvery, showing.seconds() / kShowShare);
  }
  /// Pixels a second so far; 0 while that is not known.
  double pace() const { return pixels_ > 0 ? pixels_ / std::max(1e-3, watch_.seconds()) : 0; }

 private:
  void show() {
    const ViewLook look = viewer_.current();
    Layers seen(frame_.width(), frame_.height());
    for (const std::string& layer : look.layers)
      for (const std::string& channel : ViewedLayer(frame_, layer, /*predicted=*/true, look.mix).sources()) {
        if (seen.find(channel)) continue;
        const Plane* const before = coarse_ ? coarse_->find(channel) : nullptr;
        Plane plane = before ? enlarged(*before, seen.width(), seen.height()) : Plane(seen.width(), seen.height());
        const Plane& now = frame_.at(channel);
        for (const PixelWindow& tile : tiles_)
          for (int y = tile.lo.y; y < tile.hi.y; ++y)
            std::copy(now.row(y) + tile.lo.x, now.row(y) + tile.hi.x, plane.row(y) + tile.lo.x);
        seen.set(channel, std::move(plane));
      }
    ViewPicture known = viewer_.about(/*predicted=*/true, 0, {});
    known.full = false;
    viewer_.show(look, known, seen);
  }

  Viewer& viewer_;
  const Layers& frame_;
  std::shared_ptr<const Layers> coarse_;
  std::vector<PixelWindow> tiles_;
  double pixels_ = 0, next_ = kShowEvery;
  Stopwatch watch_;
};

void Viewer::march_whole(const ViewLook& look, const Guides& guides, const Task& task) {
  tell(ViewStage::kMarching);
  const PreparedScene& prepared = scene_.prepared();
  auto frame = std::make_shared<Layers>(look.size.x, look.size.y);
  const Camera camera = prepared.camera();
  Emerging emerging(*this, *frame);
  try {
    guides.record_watched(camera, *frame, told(ViewStage::kMarching, task),
                          [&](const ivec2& from, const ivec2& to) { emerging.add(from, to); });
    marched_ = emerging.pace();
  } catch (const Interrupted&) {
    if (const double pace = emerging.pace(); pace > 0) marched_ = pace;
    throw;
  }
  guide_layers_ = guides_in(*frame);
  RenderJob job;
  job.seed = prepared.scene().render.seed;
  job.program = version_text();
  describe_render(*frame, prepared.scene(), layers_, job);
  std::tie(frame->header["sceneHash"], frame->header["sceneSettings"]) = scene_.fingerprint();
  frame->header["picture"] = std::string("predicted, without samples");
  frame->header["samplesPerPixel"] = 0;
  frame->header["exposure"] = static_cast<float>(prepared.scene().film.exposure);
  frame->header["worldToCamera"] = camera.world_to_camera();
  frame->header["worldToNDC"] = camera.world_to_ndc();
  stamp(*frame);
  keep(predicted_, frame, look, about(/*predicted=*/true, 0, {}));
}

void Viewer::trace(const ViewLook& look, const Task& task) {
  const PreparedScene& prepared = scene_.prepared();
  std::function<void(double)> cleaning;
  Host cleans = host_;
  cleans.progress = [&](const std::string&) { return cleaning; };
  Cleaner cleaner(options_.clean_filter, prepared.scene().film.exposure, cleans);
  LayerRequest wanted;
  wanted.names = {};
  wanted.guides = true;
  cleaner.request(wanted, kFirstRound);
  const auto [hash, settings] = scene_.fingerprint();
  RenderJob job;
  job.spp = look.most_samples;
  job.guide_samples = kGuideSamples;
  job.first_round = kFirstRound;
  job.seed = prepared.scene().render.seed;
  job.program = version_text();
  job.stamp = [&](Layers& frame) {
    frame.header["sceneHash"] = hash;
    frame.header["sceneSettings"] = settings;
    stamp(frame);
  };
  // Those of the whole predicted picture are what the samples' frame holds too.
  std::shared_ptr<const Layers> guides;
  {
    const std::lock_guard lock(mutex_);
    if (predicted_.frame && predicted_.about.full) guides = predicted_.frame;
  }
  job.recorded_guides = guides.get();
  const double pixels = 1.0 * look.size.x * look.size.y;
  double taken = 0, begin = 0, goal = kFirstRound;  // samples a pixel, on average: now, and of the round
  int samples = 0;                                  // a pixel of the picture that is shown, on average
  const bool has_groups = !light_groups_of(prepared.scene()).names.empty();
  const auto error = [&] { return cleaner.error() >= 0 ? std::optional(cleaner.error()) : std::nullopt; };
  const auto progress = [&](ViewStage stage, double share) {
    tell({.stage = stage,
          .samples = static_cast<int>(taken),
          .goal = static_cast<int>(std::lround(goal)),
          .share = share,
          .error = error()});
  };
  Task sampling = task;
  sampling.progress = [&](double of_all) {
    taken = std::clamp(of_all * job.spp, taken, goal);
    if (since_told_.seconds() >= kTellEvery) progress(ViewStage::kSampling, (taken - begin) / (goal - begin));
  };
  cleaning = [&](double share) {
    if (since_told_.seconds() >= kTellEvery) progress(ViewStage::kCleaning, share);
  };
  job.next_round = [&](const RenderRound& round) {
    taken = goal;
    progress(ViewStage::kCleaning, 0);
    NextRound next = cleaner.next_round(round, 0);
    double sum = 0;
    for (int t = 0; t < round.film.tile_count(); ++t)
      sum += static_cast<double>(round.film.bounds(t).pixels()) * round.film.taken(t);
    samples = static_cast<int>(std::lround(sum / pixels));
    guides.reset();
    const auto store_picture = [&] {
      store(traced_, std::make_shared<const Layers>(cleaner.picture()), look,
            about(/*predicted=*/false, samples, error()));
      const std::lock_guard lock(mutex_);
      predicted_.frame.reset();
    };
    const auto shows_groups = [&] {
      const ViewLook now = current();
      return !now.mix.empty() || std::any_of(now.layers.begin(), now.layers.end(),
                                             [](const std::string& layer) { return layer.starts_with(kLightPrefix); });
    };
    // The picture does not wait for its groups, unless they are what is seen.
    if (!has_groups || !shows_groups()) {
      store_picture();
      show(current(), traced_);
    }
    if (has_groups) {
      cleaner.clean_lights_of_picture();
      store_picture();
      if (shows_groups()) show(current(), traced_);
    }
    begin = taken;
    goal = 0;
    for (size_t t = 0; t < next.goals.size(); ++t)
      goal += round.film.bounds(static_cast<int>(t)).pixels() / pixels * next.goals[t];
    goal = std::max(goal, begin + 1);
    progress(ViewStage::kSampling, 0);
    return next;
  };
  progress(ViewStage::kSampling, 0);
  prepared.render(job, sampling);
  tell({.stage = ViewStage::kDone, .samples = samples, .goal = samples, .error = error()});
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
  const PreparedScene& prepared = scene_.prepared();
  const PathContext& context = prepared.context();
  ViewSceneText text;
  text.id = look.id;
  text.name = scene_.title();
  text.command = command(look);
  text.reloaded = reloaded;
  text.frames = scene_.frames();
  text.lo = dvec3(std::numeric_limits<double>::infinity());
  text.hi = -text.lo;
  const auto enclose = [&](const Medium::Sphere& sphere) {
    text.lo = glm::min(text.lo, sphere.centre - sphere.radius + prepared.world_shift());
    text.hi = glm::max(text.hi, sphere.centre + sphere.radius + prepared.world_shift());
  };
  for (const Medium& m : context.media) enclose(m.bounding_sphere());
  for (const EmissionField& e : context.emissions) enclose(e.bounding_sphere());
  if (!(text.lo.x < text.hi.x)) {
    text.lo = prepared.scene().camera.look_at - 1.0;
    text.hi = prepared.scene().camera.look_at + 1.0;
  }
  text.layers = kTracedLayers;
  text.light_groups = light_groups_of(prepared.scene()).names;
  for (const std::string& group : text.light_groups)
    text.layers.push_back({light_layer(group), group, 3, "light groups", "W/(m^2 sr)"});
  text.layers.insert(text.layers.end(), guide_layers_.begin(), guide_layers_.end());
  told_layers_ = guide_layers_;
  text.notes = scene_.notes();
  text.left_out = left_out_of(prepared.scene(), prepared.medium() || !context.emissions.empty());
  const auto enabled_volumes =
      static_cast<size_t>(std::count_if(scene_.tables().begin(), scene_.tables().end(), [](const SceneTable& t) {
        return t.path.starts_with("volumes.") && is_enabled(t);
      }));
  size_t volume = 0;
  for (const SceneTable& table : scene_.tables()) {
    ViewSceneText::Table& entry = text.tables.emplace_back();
    entry.keys = table;
    entry.title = title_of(table);
    if (!table.path.starts_with("volumes.")) continue;
    if (const SceneKey* const file = table.find("file")) entry.grids = scene_.grids(std::get<std::string>(file->value));
    if (is_enabled(table) && enabled_volumes == context.media.size())
      entry.depth = depths_along_axes(context.media[volume++].thickest());
  }
  listener_.scene(text);
  const std::lock_guard lock(mutex_);
  told_scene_ = std::move(text);
}

}  // namespace brume
