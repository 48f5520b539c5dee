#include "workflows/viewer.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

#include "base/error.h"
#include "base/sequence.h"
#include "image/packed_half.h"
#include "render/scene/scene_io.h"
#include "volume/tracking.h"
#include "workflows/scene.h"
#include "workflows/version.h"

namespace brume {
namespace {

using namespace std::chrono_literals;

constexpr auto kRest = 150ms;            // without a look, after which a moving picture is at rest
constexpr double kMovingSeconds = 0.06;  // that the march of a moving picture may take
constexpr double kFewestPixels = 6000;   // of a moving picture
constexpr double kFirstPace = 3e5;       // pixels a second, until one has been measured
constexpr int kFirstRound = 8;           // samples a pixel
constexpr int kMostSamples = 1 << 20;
constexpr int kGuideSamples = ViewedScene::kGuideSamples;
constexpr double kFar = 1e30;  // scene units

const std::string kPicture = "picture", kGuide = "guide.";

/// The channels that a name of ViewSceneText::layers stands for; several sets are added up.
std::vector<std::vector<const Plane*>> planes_of(const Layers& frame, const std::string& layer, bool predicted) {
  const auto group = [&](const std::string& name) {
    std::vector<const Plane*> planes;
    for (const char* letters : {"RGB", "XYZ", "Y", "Z", "A"}) {
      planes.clear();
      for (const char* c = letters; *c; ++c)
        if (const Plane* const plane = frame.find(name.empty() ? std::string(1, *c) : name + "." + *c))
          planes.push_back(plane);
      if (planes.size() == std::string_view(letters).size()) return planes;
    }
    planes.clear();
    return planes;
  };
  if (!predicted) return {group(layer == kPicture ? "" : layer)};
  if (layer == kPicture) return {group("guide.predicted_direct"), group("guide.predicted_indirect")};
  if (layer == "direct" || layer == "clean_direct") return {group("guide.predicted_direct")};
  if (layer == "indirect" || layer == "clean_indirect") return {group("guide.predicted_indirect")};
  return {group(layer)};
}

/// The names of the guides in a frame.
std::vector<ViewSceneText::Layer> guides_in(const Layers& frame) {
  std::vector<ViewSceneText::Layer> layers;
  for (const auto& [channel, plane] : frame.channels()) {
    if (!channel.starts_with(kGuide)) continue;
    const std::string name = channel.substr(0, channel.rfind('.'));
    if (layers.empty() || layers.back().name != name) layers.push_back({name, name, 0});
    ++layers.back().channels;
  }
  std::erase_if(layers, [](const auto& layer) { return layer.channels != 1 && layer.channels != 3; });
  return layers;
}

const std::vector<ViewSceneText::Layer> kTracedLayers = {
    {kPicture, "picture", 3},
    {"noisy", "noisy", 3},
    {"clean_direct", "direct, clean", 3},
    {"clean_indirect", "indirect, clean", 3},
    {"direct", "direct, noisy", 3},
    {"indirect", "indirect, noisy", 3},
    {"clean_error", "estimated error", 1},
    {"sample_count", "samples", 1},
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
    for (const Medium& m : context.media) sum += optical_depth(m, m.to_local(ray), t);
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
      scene_(options.scene, options.frames, options.overrides, layers_),
      pixels_a_second_(kFirstPace) {
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
  if (tracing_ && frame_ && !next_ && look.differs_in_layers_alone(*last_)) {
    last_ = std::move(look);
    show(*last_, about_frame_, *frame_);
    return;
  }
  next_ = std::move(look);
  cancel_ = true;
  woken_.notify_all();
}

void Viewer::probe(const ViewProbe& probe) {
  const std::lock_guard lock(mutex_);
  next_probe_ = probe;
  // What is being drawn goes on afterwards.
  if (!next_ && last_) next_ = last_;
  cancel_ = true;
  woken_.notify_all();
}

void Viewer::pause() {
  const std::lock_guard lock(mutex_);
  next_.reset();
  tracing_ = false;
  paused_ = true;
  cancel_ = true;
}

void Viewer::check_file() {
  const std::lock_guard lock(mutex_);
  if (next_ || !last_ || file_.empty() || paused_) return;
  std::error_code error;
  const auto written = std::filesystem::last_write_time(file_, error);
  if (error || written == written_) return;
  reload_ = true;
  next_ = last_;
  cancel_ = true;
  woken_.notify_all();
}

std::shared_ptr<const Layers> Viewer::frame() const {
  const std::lock_guard lock(mutex_);
  return frame_;
}

std::string Viewer::scene_text() const {
  const std::lock_guard lock(mutex_);
  return scene_text_;
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
      tracing_ = false;
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
      listener_.problem(id, error.what());
    }
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

bool Viewer::update_scene(const ViewLook& look, const Task& task) {
  const auto keep_file = [&] {
    const std::lock_guard lock(mutex_);
    file_ = scene_.file();
    written_ = scene_.written();
  };
  try {
    const bool changed = scene_.show(look.assignments, look.size, look.frame, task);
    keep_file();
    return changed;
  } catch (...) {
    keep_file();  // a file that is wrong is looked at again when it changes
    throw;
  }
}

void Viewer::answer(const ViewLook& look) {
  asked_ = Stopwatch();
  bool reloaded = false;
  {
    const std::lock_guard lock(mutex_);
    reloaded = std::exchange(reload_, false);
    if (reloaded) scene_.read_again();
  }
  // A look that is on its way is not given up for the next one: under a moving mouse none would ever be answered.
  const Task whole{host_.threads, {}, nullptr}, until_next{host_.threads, {}, &cancel_};
  if (scene_.empty() || reloaded) tell(look, ViewStage::kReading);
  const bool changed = update_scene(look, whole);
  if ((changed && !look.moving) || reloaded || look.needs_scene) tell_scene(look, reloaded);
  const bool predicts = scene_.prepared().medium() || !scene_.prepared().context().emissions.empty();
  if (predicts) {
    if (changed) tell(look, ViewStage::kSolvingLight);
    const Guides& sketch = scene_.sketch(whole);
    const double pixels = 1.0 * look.size.x * look.size.y;
    const double shrunk = std::sqrt(std::min(1.0, std::max(kFewestPixels, kMovingSeconds * pixels_a_second_) / pixels));
    if (look.moving || changed)
      predict(look, sketch, glm::max(ivec2(glm::round(dvec2(look.size) * shrunk)), ivec2(1)), whole);
  }
  if (look.moving) {
    if (!rests()) return;
    if (changed) tell_scene(look, false);
  }
  if (predicts) {
    if (!scene_.has_guides()) {
      predict(look, scene_.sketch(until_next), look.size, until_next);
      tell(look, ViewStage::kSolvingLight);
    }
    predict(look, scene_.guides(until_next), look.size, until_next);
  }
  tell_scene(look, false);  // with the guides that there are, and the camera as it is
  trace(look, until_next);
}

void Viewer::predict(const ViewLook& look, const Guides& guides, const ivec2& size, const Task& task) {
  tell(look, ViewStage::kMarching);
  const Stopwatch watch;
  const PreparedScene& prepared = scene_.prepared();
  Layers frame(size.x, size.y);
  const Camera camera(prepared.scene().camera, size.x, size.y, prepared.world_shift());
  guides.record(camera, ivec2(0), frame, task, /*sketch=*/size != look.size);
  pixels_a_second_ = 1.0 * size.x * size.y / std::max(1e-3, watch.seconds());
  guide_layers_ = guides_in(frame);
  show(look, about(/*predicted=*/true, 0, {}), frame);
}

void Viewer::trace(const ViewLook& look, const Task& task) {
  const PreparedScene& prepared = scene_.prepared();
  Cleaner cleaner(options_.clean_filter, prepared.scene().film.exposure, host_);
  LayerRequest wanted;
  wanted.names = {};
  wanted.guides = true;
  cleaner.request(wanted, kFirstRound);
  RenderJob job;
  job.spp = kMostSamples;
  job.guide_samples = kGuideSamples;
  job.first_round = kFirstRound;
  job.seed = prepared.scene().render.seed;
  job.program = version_text();
  job.stamp = [](Layers& frame) { stamp(frame); };
  int samples = 0;
  job.next_round = [&](const RenderRound& round) {
    NextRound next = cleaner.next_round(round, 0);
    samples = std::numeric_limits<int>::max();
    for (int t = 0; t < round.film.tile_count(); ++t)
      samples = std::min(samples, static_cast<int>(round.film.taken(t)));
    const std::optional<double> error = cleaner.error() >= 0 ? std::optional(cleaner.error()) : std::nullopt;
    const auto frame = std::make_shared<const Layers>(cleaner.picture());
    const ViewLook now = current();
    const ViewPicture known = about(/*predicted=*/false, samples, error);
    {
      const std::lock_guard lock(mutex_);
      frame_ = frame;
      about_frame_ = known;
    }
    show(now, known, *frame);
    tell(now, ViewStage::kSampling, samples, error);
    return next;
  };
  tell(look, ViewStage::kSampling);
  {
    const std::lock_guard lock(mutex_);
    frame_.reset();
    tracing_ = true;
  }
  prepared.render(job, task);
  tell(current(), ViewStage::kDone, samples, cleaner.error() >= 0 ? std::optional(cleaner.error()) : std::nullopt);
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
    std::vector<std::vector<const Plane*>> sets = planes_of(frame, layer, about.predicted);
    std::erase_if(sets, [](const auto& set) { return set.empty(); });
    if (sets.empty()) continue;
    ViewPicture picture = about;
    picture.id = look.id;
    picture.layer = layer;
    picture.width = frame.width();
    picture.height = frame.height();
    picture.channels = static_cast<int>(sets[0].size());
    picture.full = ivec2(frame.width(), frame.height()) == look.size;
    for (size_t c = 0; c < sets[0].size(); ++c) {
      Plane sum = *sets[0][c];
      for (size_t other = 1; other < sets.size(); ++other)
        for (int y = 0; y < sum.height(); ++y)
          for (int x = 0; x < sum.width(); ++x) sum(x, y) += (*sets[other][c])(x, y);
      const std::vector<uint16_t> halves = half_bits(sum);
      picture.halves.insert(picture.halves.end(), halves.begin(), halves.end());
    }
    listener_.picture(std::move(picture));
  }
}

void Viewer::tell(const ViewLook& look, ViewStage stage, int samples, std::optional<double> error) {
  listener_.progress(look.id, stage, samples, error, asked_.seconds());
}

void Viewer::tell_scene(const ViewLook& look, bool reloaded) {
  const PreparedScene& prepared = scene_.prepared();
  const PathContext& context = prepared.context();
  ViewSceneText text;
  text.id = look.id;
  text.name = prepared.scene().name;
  text.command = scene_.command();
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
  text.layers.insert(text.layers.end(), guide_layers_.begin(), guide_layers_.end());
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
      entry.depth = depths_along_axes(context.media[volume++]);
  }
  listener_.scene(text);
  const std::lock_guard lock(mutex_);
  scene_text_ = scene_.text();
}

}  // namespace brume
