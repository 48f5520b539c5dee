#include "workflows/render_frame.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "image/exr_deep.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_outline.h"
#include "render/scene/volume_time.h"
#include "render/session/renderer.h"
#include "workflows/clean.h"
#include "workflows/deep_frame.h"
#include "workflows/finished_frame.h"
#include "workflows/matte_frame.h"
#include "workflows/motion.h"
#include "workflows/scene.h"
#include "workflows/version.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr int kSamplesWithoutLimit = 16;  // that guides are made for where time or error end the render
constexpr int kMostSamples = 1 << 20;     // where they do, too

/// "64 samples per pixel", or how many where tiles have different numbers.
std::string samples_text(const RenderReport& report) {
  if (report.most_samples_per_pixel == report.samples_per_pixel)
    return fmt::format("{} samples per pixel", report.samples_per_pixel);
  return fmt::format("{} to {} samples per pixel, {:.1f} on average", report.samples_per_pixel,
                     report.most_samples_per_pixel, report.mean_samples_per_pixel);
}

/// Tells what is made up around a bare volume, and saves it where that is asked for.
void tell_assumptions(const RenderOptions& o, const VolumeScene& made, const Host& host) {
  for (const std::string& line : made.all_assumptions()) host.log("assumed " + line);
  if (o.save_scene.empty()) {
    host.log("--save-scene FILE.toml keeps these as a scene to edit, -D KEY=VALUE changes one");
    return;
  }
  const fs::path inputs[] = {o.scene};
  check_writable(o.save_scene, inputs, ".toml");
  const auto folder = fs::absolute(o.save_scene).parent_path();
  write_text(o.save_scene, moved_scene(made.text(fs::proximate(o.scene, folder).generic_string()), folder / "",
                                       o.overrides, o.scene));
}

Scene scene_of(const RenderOptions& o, const Host& host) {
  if (!o.scene_text.empty() && o.scenes) {
    Scene scene = parse_scene_alone(o.scene_text, o.scene, o.overrides, o.arrays);
    o.scenes->add_fingerprint(scene);
    return scene;
  }
  if (!o.scene_text.empty()) return parse_scene(o.scene_text, o.scene, o.overrides, o.arrays);
  LoadedScene loaded = load_scene(o.scene, o.overrides, host.silent());
  if (loaded.made)
    tell_assumptions(o, *loaded.made, host);
  else if (!o.save_scene.empty())
    throw InputError(
        fmt::format("--save-scene writes what is assumed about a bare volume; {} is a scene", o.scene.string()));
  return std::move(loaded.scene);
}

/// @throws InputError where an output cannot be written, or would replace what is read
void check_outputs(const RenderOptions& o, const Scene& scene) {
  std::vector<fs::path> inputs = {o.scene, scene.environment.file, scene.camera.from_exr};
  for (const VolumeSettings& volume : scene.volumes)
    for (const VolumeSettings* v : {&volume, volume.moment.later.get()})
      for (const auto& [key, file] : kVolumeFiles)
        if (v) inputs.push_back(v->*file);
  for (const InstanceSettings& instances : scene.instances) inputs.push_back(instances.file);
  for (const SurfaceSettings& surface : scene.surfaces)
    inputs.insert(inputs.end(),
                  {surface.file, surface.albedo_texture, surface.alpha_texture, surface.radiance_texture});
  for (const fs::path& file : {o.checkpoint, o.updates, o.deep})
    if (!file.empty()) check_writable(file, inputs, ".exr");
  inputs.push_back(o.resume);
  for (const auto& [file, ending] : {std::pair(&o.output, ".exr"), {&o.preview, ".png"}, {&o.records, ".records"}})
    if (!file->empty()) check_writable(*file, inputs, ending);
  if (!o.preview.empty()) o.picture.check();
  const auto same = [](const fs::path& a, const fs::path& b) {
    return !a.empty() && !b.empty() && fs::weakly_canonical(a) == fs::weakly_canonical(b);
  };
  if (same(o.output, o.checkpoint))
    throw InputError(fmt::format("{}: is the checkpoint too, which the picture would replace; name another output",
                                 o.output.string()));
  for (const auto& [option, file] : {std::pair("--updates", &o.updates), {"--deep", &o.deep}})
    for (const fs::path* other : {&o.output, &o.checkpoint, &o.resume, &o.updates})
      if (other != file && same(*file, *other))
        throw InputError(
            fmt::format("{} {}: is another file of this command too; name one of its own", option, file->string()));
}

RenderJob::Crop parse_crop(const std::string& text, const FilmSettings& film) {
  RenderJob::Crop c{};
  int used = 0;
  if (std::sscanf(text.c_str(), "%d,%d,%d,%d%n", &c.x0, &c.y0, &c.x1, &c.y1, &used) != 4 ||
      static_cast<size_t>(used) != text.size() || c.x0 < 0 || c.y0 < 0 || c.x1 <= c.x0 || c.y1 <= c.y0 ||
      c.x1 > film.width || c.y1 > film.height)
    throw InputError(fmt::format("--crop {}: expected x0,y0,x1,y1 inside 0,0,{},{}, the last two exclusive", text,
                                 film.width, film.height));
  return c;
}

/// A render as its options say it, decided before anything is computed.
struct Setup {
  const RenderOptions& options;
  const Host& host;
  Scene scene;
  LayerRequest layers;
  RenderJob job;
  std::optional<Cleaner> cleaner;
  bool open_ended;           // by time or error
  bool drop_guides = false;  // which are made for the deep picture alone
  std::optional<MotionScenes> motion;

  /// Whether samples go in rounds where the clean picture needs them.
  bool in_rounds() const { return options.time_limit > 0 || options.target_error > 0; }

  Setup(const Setup&) = delete;  // its job calls it
  Setup(const RenderOptions& o, const Host& h)
      : options(o),
        host(h),
        scene(scene_of(o, h)),
        layers(o.layers),
        open_ended(!o.spp && (o.time_limit > 0 || o.target_error > 0)) {
    check_outputs(o, scene);
    scene.render.spp = open_ended ? kMostSamples : o.spp.value_or(scene.render.spp);
    scene.render.seed = o.seed.value_or(scene.render.seed);
    layers.records = !o.records.empty();
    if (!o.clean_filter.empty()) set_cleaner();
    if (!o.deep.empty() || layers.depths || layers.motion) set_deep();
    if (layers.mattes()) set_mattes();
    set_job();
  }

 private:
  void set_cleaner() {
    if (options.part) throw InputError("--clean: a part is cleaned once it is merged, by brume denoise");
    cleaner.emplace(options.clean_filter, scene.film.exposure, host, options.outliers);
    layers = cleaner->request(layers, scene.render.spp);
    if (options.target_error > 0 && !cleaner->estimates_error())
      throw InputError(fmt::format(
          "--target-error with --clean needs a filter that estimates its error, which {} does not; take transport_regression",
          options.clean_filter));
  }

  void set_deep() {
    if (options.part)
      throw InputError(
          "a part has not all samples of the picture; expected --deep and the layers depths and motion without --part");
    drop_guides = !cleaner && !layers.guides;
    layers.guides = true;
    job.deep_samples = options.deep_samples;
  }

  void set_mattes() {
    if (options.part)
      throw InputError(
          "mattes are the whole picture's, and so is its alpha then; expected --layers cryptomatte without --part");
    job.mattes = true;
  }

  void set_job() {
    job.spp = scene.render.spp;
    if (open_ended) job.guide_samples = kSamplesWithoutLimit;
    job.seed = scene.render.seed;
    if (options.part) {
      job.part = options.part->number;
      job.parts = options.part->parts;
      job.keep_state = true;
      if (job.parts > job.spp)
        throw InputError(fmt::format("--part {}/{}: {} samples per pixel cannot be shared by {} parts", job.part,
                                     job.parts, job.spp, job.parts));
    }
    if (!options.crop.empty()) job.crop = parse_crop(options.crop, scene.film);
    job.time_limit = options.time_limit;
    job.target_error = cleaner ? 0 : options.target_error;
    // A checkpoint that is resumed is also where to go on checkpointing.
    job.checkpoint = options.checkpoint.empty() ? options.resume : options.checkpoint;
    job.checkpoint_seconds = options.checkpoint_seconds;
    job.resume = options.resume;
    job.records = options.records;
    job.program = version_text();
    job.stamp = [](Layers& frame) { stamp(frame); };
    if (cleaner) job.stored = [this](const std::string& channel) { return cleaner->may_store(channel); };
    job.warn = [this](const std::string& text) { host.say(Host::Word::kWarning, text); };
  }
};

/// Why a frame of a sequence that is resumed must be rendered; nothing where it need not.
std::optional<std::string> why_to_render(const Setup& s) {
  RenderJob asked = s.job;
  asked.target_error = s.options.target_error;  // also where the clean picture's error ends the render
  std::string wrong = what_is_unfinished(s.options.output, s.scene, s.layers, asked,
                                         s.cleaner ? &s.cleaner->filter() : nullptr, s.host.silent());
  if (!wrong.empty()) return wrong;
  for (const fs::path& beside : {s.options.preview, s.options.records, s.options.deep})
    if (!beside.empty() && !fs::exists(beside)) return fmt::format("{} is not there", beside.string());
  return std::nullopt;
}

/// Goes on from the checkpoint of a frame, where there is one of this render. @return false where the frame is complete
bool resume_frame(Setup& s) {
  const std::optional<std::string> why = why_to_render(s);
  if (!why) return false;
  const fs::path& checkpoint = s.options.checkpoint;
  if (fs::exists(s.options.output))
    s.host.message(fmt::format("{} is rendered again: {}", s.options.output.string(), *why));
  if (!checkpoint.empty() && fs::exists(checkpoint)) {
    const std::string forbids = what_forbids_resuming(checkpoint, s.scene, s.layers, s.job, s.host.silent());
    if (forbids.empty())
      s.job.resume = checkpoint;
    else
      s.host.message(fmt::format("the checkpoint {} is left aside: {}", checkpoint.string(), forbids));
  }
  s.job.checkpoint_at_end = false;
  return true;
}

/// What was reached of a target error, of the clean picture where one was made.
/// @return whether it was missed
bool tell_error(const Setup& s, const RenderReport& report) {
  const double target = s.options.target_error, error = s.cleaner ? s.cleaner->error() : report.error.value_or(0);
  const bool missed = target > 0 && !(error <= target);
  if (s.cleaner ? error < 0 : !(target > 0)) return missed;
  const std::string reached = s.cleaner ? fmt::format("estimated relative error of the clean picture {:.4g}", error)
                              : std::isfinite(error)
                                  ? fmt::format("estimated relative error {:.4g}", error)
                                  : "no error can be estimated: fewer than 8 samples per pixel, or no light was found";
  if (missed)
    s.host.message(fmt::format("target error {} not reached with {}: {}", target, samples_text(report), reached));
  else
    s.host.log(reached);
  return missed;
}

/// Tells what came of a render. @return whether a threshold was missed
bool tell_result(const Setup& s, const Plan& plan, const RenderReport& report) {
  s.host.log(report.summary());
  if (plan.has_media() && !plan.emission && report.counters.paths > 0 && report.counters.tracking.collisions == 0)
    s.host.note("no path met the medium; does the camera look past it? 'brume info' tells where a volume lies");
  if (report.samples_per_pixel > s.scene.render.spp)
    s.host.note(fmt::format("the checkpoint held more samples per pixel, {}, than the {} asked for",
                            report.samples_per_pixel, s.scene.render.spp));
  if (s.open_ended) s.host.log(samples_text(report));
  if (s.cleaner) s.host.log(fmt::format("cleaned in {:.2f} s", s.cleaner->seconds()));
  const bool missed = tell_error(s, report);
  // One bad sample in a million is reported; more is a failure (docs/methods.md, Numerical rules).
  const double allowed = s.options.require_valid ? 0.0 : 1e-6 * static_cast<double>(report.counters.paths);
  return missed || (!s.cleaner && static_cast<double>(report.invalid_samples) > allowed);
}

/// A scene made ready, kept by the caller's cache or for one render alone.
class Ready {
 public:
  /// Tells what the user should know of the scene.
  explicit Ready(const Setup& s) {
    if (s.options.scenes)
      scene_ = &s.options.scenes->prepare(s.scene, s.layers, s.host.silent());
    else
      scene_ = (own_ = std::make_unique<PreparedScene>(s.scene, s.layers, s.host.silent())).get();
    for (const std::string& text : scene_->notes()) s.host.note(text);
  }
  const PreparedScene* operator->() const { return scene_; }
  /// Frees what nobody keeps.
  void let_go() { own_.reset(); }

 private:
  std::unique_ptr<PreparedScene> own_;
  const PreparedScene* scene_ = nullptr;
};

/// The options of one frame of a sequence: its names, its number.
RenderOptions of_frame(const RenderOptions& sequence, int frame) {
  RenderOptions options = sequence;
  for (fs::path RenderOptions::*name :
       {&RenderOptions::output, &RenderOptions::preview, &RenderOptions::records, &RenderOptions::checkpoint,
        &RenderOptions::resume, &RenderOptions::updates, &RenderOptions::deep})
    options.*name = file_of_frame(options.*name, frame);
  options.overrides.push_back(fmt::format("render.frame={}", frame));
  if (options.fixed_seed) options.overrides.push_back("render.noise_frame=0");
  return options;
}

/// The folder of an output may be named by the frame: then it is made.
void make_folder_of_frame(const fs::path& pattern, int frame) {
  const fs::path folder = pattern.parent_path();
  std::error_code ignored;  // told when the file is written
  if (FramePattern::of(folder)) fs::create_directory(file_of_frame(folder, frame), ignored);
}

/// Keeps RenderOptions::updates the newest picture.
class UpdatedPicture {
 public:
  UpdatedPicture(const Setup& setup) : setup_(setup) {}

  /// @param samples  per pixel, on average   @param error  relative; nothing where none is estimated
  void show(const Layers& frame, double samples, std::optional<double> error, bool last) {
    if (failed_) return;
    Layers picture = frame.without_channels();
    for (const LayerName& l : {layer::beauty, layer::alpha})
      for (const std::string& channel : l.channel_names()) picture.set(channel, frame.at(channel));
    const fs::path& file = setup_.options.updates;
    try {
      write_exr(file, picture);
    } catch (const InputError& problem) {  // which must not cost the render
      setup_.host.say(Host::Word::kWarning, fmt::format("{}; no more pictures are shown", problem.what()));
      failed_ = true;
      return;
    }
    if (error && !std::isfinite(*error)) error.reset();
    if (setup_.host.updated) setup_.host.updated({file, ++number_, samples, error, watch_.seconds(), last});
  }

 private:
  const Setup& setup_;
  Stopwatch watch_;
  int number_ = 0;
  bool failed_ = false;
};

double mean_samples(const Film& film) {
  double taken = 0, pixels = 0;
  for (int tile = 0; tile < film.tile_count(); ++tile) {
    taken += static_cast<double>(film.bounds(tile).pixels()) * film.taken(tile);
    pixels += film.bounds(tile).pixels();
  }
  return taken / pixels;
}

/// The scene a frame earlier or later; the same where that cannot be read.
Scene neighbour(const Setup& s, int by) {
  const int frame = s.scene.render.frame + by;
  if (frame < 0) return s.scene;
  RenderOptions options = s.options;
  if (!options.sequence.empty()) options.scene = file_of_frame(options.sequence, frame);
  options.save_scene.clear();
  options.overrides.push_back(fmt::format("render.frame={}", frame));
  try {
    Host silent;  // what is assumed has been told
    silent.threads = s.host.threads;
    silent.cancel = s.host.cancel;
    return scene_of(options, silent);
  } catch (const InputError& error) {
    s.host.say(
        Host::Word::kWarning,
        fmt::format("the layer motion: camera and objects stand still towards frame {}: {}", frame, error.what()));
    return s.scene;
  }
}

/// What the march of guides tells of depths: layers, and a deep picture, whose alpha the frame gets. The frame loses
/// the guides that nobody asked for.
void use_depths(Setup& s, const DeepRecord& parts, Layers& frame) {
  using Type = DeepPicture::Channel::Type;
  if (s.layers.depths) add_depths(parts, s.scene, frame);
  if (s.motion)
    add_motion(
        parts, *std::move(s.motion), frame, [&](const std::string& text) { s.host.note(text); }, s.host.task("motion"));
  if (!s.options.deep.empty())
    write_deep_exr(s.options.deep, deep_frame(parts, frame, s.options.deep_float ? Type::kFloat : Type::kHalf),
                   s.host.silent());
  if (!s.drop_guides) return;
  for (const std::string& name : frame.names())
    if (name.starts_with("guide.")) frame.remove(name);
}

std::optional<double> clean_error_of(const Setup& s) {
  return s.cleaner && s.cleaner->error() >= 0 ? std::optional(s.cleaner->error()) : std::nullopt;
}

/// Says who is shown what while the picture is rendered.
void watch_render(Setup& s, RenderWatcher* watcher, UpdatedPicture* updated) {
  if (watcher) s.job.watch = [=](const Film& picture, int tile) { watcher->update(picture, tile); };
  if (watcher || updated)
    s.job.show = [=, &s](const Film& film, const std::function<Layers()>& frame, bool first) {
      const bool clean = s.cleaner && !first;
      const bool waits = watcher && (clean || !s.cleaner) && watcher->waits();
      if (!waits && !updated) return;
      const Layers picture = clean ? s.cleaner->clean(frame()) : frame();
      if (waits) watcher->show(picture);
      if (!updated) return;
      std::optional<double> error = clean_error_of(s);
      if (!clean) error = s.layers.statistics ? film.relative_error(s.scene.film.exposure) : std::optional<double>();
      updated->show(picture, mean_samples(film), error, false);
    };
  if (s.cleaner && s.in_rounds())
    s.job.next_round = [&s, watcher, updated](const RenderRound& round) {
      NextRound next = s.cleaner->next_round(round, s.options.target_error);
      const Layers& picture = s.cleaner->picture();
      if (watcher) watcher->show(picture);
      if (updated) updated->show(picture, mean_samples(round.film), clean_error_of(s), false);
      return next;
    };
}

}  // namespace

RenderedFrame render_frame(const RenderOptions& options, const Host& host) {
  Setup s(options, host);
  RenderedFrame rendered;
  rendered.end = FrameEnd::kSkipped;
  if (options.skip_complete && !resume_frame(s)) return rendered;
  Ready prepared(s);
  if (s.layers.motion) s.motion = MotionScenes{s.scene, neighbour(s, -1), neighbour(s, 1)};
  for (VolumeSettings& volume : s.scene.volumes) volume.grids.reset();
  std::unique_ptr<RenderWatcher> watcher;
  if (options.watch) {
    const FilmSettings& film = s.scene.film;
    watcher = options.watch(
        s.scene.name, s.job.crop ? ivec2(s.job.crop->width(), s.job.crop->height()) : ivec2(film.width, film.height));
  }
  std::optional<UpdatedPicture> updated;
  if (!options.updates.empty()) updated.emplace(s);
  watch_render(s, watcher.get(), updated ? &*updated : nullptr);

  RenderResult result = prepared->render(s.job, host.task("render " + s.scene.name));
  const Plan plan = prepared->plan();
  prepared.let_go();  // the volumes and their light are not held while the picture is cleaned
  if (s.cleaner) {
    result.layers = s.cleaner->clean_with_parts(std::move(result.layers));
    if (watcher) watcher->show(result.layers);
  }
  if (result.deep) use_depths(s, *result.deep, result.layers);
  if (result.mattes) add_mattes(*result.mattes, s.layers, s.scene.render, !s.options.deep.empty(), result.layers);
  if (updated)
    updated->show(result.layers, result.report.mean_samples_per_pixel,
                  s.cleaner ? clean_error_of(s) : result.report.error, true);
  if (!options.output.empty()) write_exr(options.output, result.layers);
  std::error_code ignored;
  if (options.skip_complete && !options.checkpoint.empty()) fs::remove(options.checkpoint, ignored);
  if (!options.preview.empty()) options.picture.write(options.preview, result.layers);
  rendered.end = tell_result(s, plan, result.report) ? FrameEnd::kMissed : FrameEnd::kDone;
  if (!options.output.empty() && host.wrote) host.wrote(options.output);
  rendered.clean_error = clean_error_of(s);
  rendered.layers = std::move(result.layers);
  rendered.report = result.report;
  return rendered;
}

SequenceEnd render_sequence(const RenderOptions& options, const std::vector<int>& frames, const Host& host) {
  const std::vector<std::string> untimed = without_time(options.overrides);
  const auto pattern = FramePattern::of(options.scene);
  // Whose frames are not the scene's.
  const bool retimed = pattern && untimed.size() < options.overrides.size();
  const std::vector<int> files = retimed ? pattern->frames_on_disk() : frames;
  const bool bare = options.scene_text.empty() && std::any_of(files.begin(), files.end(), [&](int frame) {
                      return is_volume(file_of_frame(options.scene, frame));
                    });
  std::optional<VolumeScene> made;
  if (bare) try {
      made = scene_for_volumes(options.scene, files, untimed, host.silent());
      tell_assumptions(options, *made, host);
    } catch (const InputError&) {
      // No frame can be looked at: each says why, below.
      if (frames.size() == 1) throw;
    }
  return each_frame(frames, host, [&](int frame) {
    RenderOptions own = of_frame(options, frame);
    const bool of_pattern = made && retimed;
    own.scene = of_pattern ? options.scene : file_of_frame(options.scene, frame);
    own.sequence = options.scene;
    if (made) {
      own.save_scene.clear();
      if (!of_pattern) check_exists(own.scene);
      own.scene_text = made->text(own.scene.filename().string());
    }
    for (const fs::path& name :
         {options.output, options.preview, options.records, options.checkpoint, options.updates, options.deep})
      make_folder_of_frame(name, frame);
    return render_frame(own, host).end;
  });
}

std::string explain_render(const RenderOptions& options, const Host& host) {
  const Setup s(options, host);
  return Ready(s)->explain(s.job.samples_for_guides(), host.silent());
}

std::string replay_sample(const RenderOptions& options, const std::string& which, const Host& host) {
  const Setup s(options, host);
  const Ready prepared(s);
  int x = 0, y = 0, sample = 0, used = 0;
  const FilmSettings& film = s.scene.film;
  if (std::sscanf(which.c_str(), "%d,%d,%d%n", &x, &y, &sample, &used) != 3 ||
      static_cast<size_t>(used) != which.size() || x < 0 || x >= film.width || y < 0 || y >= film.height || sample < 0)
    throw InputError(fmt::format("--replay {}: expected x,y,sample with x below {}, y below {}, sample from 0", which,
                                 film.width, film.height));
  const PathSample traced = prepared->replay(s.scene.render.seed, x, y, static_cast<uint32_t>(sample));
  std::string text;
  for (const RecordedLayer& l : recordable_layers()) {
    text += l.name.name;
    for (size_t c = 0; c < l.name.channels.size(); ++c) text += fmt::format(" {}", traced.values()[l.offset + c]);
    text += "\n";
  }
  return text;
}

}  // namespace brume
