#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>

#include "app/command.h"
#include "app/filter_options.h"
#include "app/frame.h"
#include "app/sequence.h"
#include "app/tev.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "render/frame/renderer.h"
#include "render/scene/scene_io.h"
#include "workflows/clean.h"
#include "workflows/finished_frame.h"
#include "workflows/scene.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

constexpr const char* kResumeFrames = "frames";  // --resume without a file
constexpr int kSkipped = -1;                     // what run() says of a frame that was complete
constexpr int kSamplesWithoutLimit = 16;         // that guides are made for where time or error end the render

struct Options {
  std::string scene, output, preview, layers = "direct,indirect,gradient,coverage,transmittance", replay;
  std::string part, crop, time, checkpoint, resume, tev, records, save_scene, clean_filter, frames;
  std::vector<std::string> overrides;
  int spp = 0;
  int64_t seed = -1;
  double target_error = 0, checkpoint_every = 300;
  bool clean = false, layers_given = false, no_statistics = false, buckets = false, explain = false,
       require_valid = false, fixed_seed = false, skip_complete = false;
  OutlierOption outliers;
  PictureOptions picture;
} o;

int replay(const PreparedScene& scene, int64_t seed) {
  int v[3] = {}, used = 0;
  const FilmSettings& film = scene.scene().film;
  if (std::sscanf(o.replay.c_str(), "%d,%d,%d%n", v, v + 1, v + 2, &used) != 3 ||
      static_cast<size_t>(used) != o.replay.size() || v[0] < 0 || v[0] >= film.width || v[1] < 0 ||
      v[1] >= film.height || v[2] < 0)
    throw InputError(fmt::format("--replay {}: expected x,y,sample with x below {}, y below {}, sample from 0",
                                 o.replay, film.width, film.height));
  const PathSample s = scene.replay(seed, v[0], v[1], static_cast<uint32_t>(v[2]));
  for (const RecordedLayer& l : recordable_layers()) {
    std::string line(l.name.name);
    for (size_t c = 0; c < l.name.channels.size(); ++c) line += fmt::format(" {}", s.values()[l.offset + c]);
    print(line + "\n");
  }
  return kDone;
}

void parse_part(RenderJob& job) {
  if (o.part.empty()) return;
  int used = 0;
  if (std::sscanf(o.part.c_str(), "%d/%d%n", &job.part, &job.parts, &used) != 2 ||
      static_cast<size_t>(used) != o.part.size() || job.part < 1 || job.part > job.parts)
    throw InputError(fmt::format("--part {}: expected i/N, for example 2/4, with i from 1 to N", o.part));
  if (job.parts > job.spp)
    throw InputError(
        fmt::format("--part {}: {} samples per pixel cannot be shared by {} parts", o.part, job.spp, job.parts));
  job.keep_state = true;
}

void parse_crop(RenderJob& job, const FilmSettings& film) {
  if (o.crop.empty()) return;
  RenderJob::Crop c{};
  int used = 0;
  if (std::sscanf(o.crop.c_str(), "%d,%d,%d,%d%n", &c.x0, &c.y0, &c.x1, &c.y1, &used) != 4 ||
      static_cast<size_t>(used) != o.crop.size() || c.x0 < 0 || c.y0 < 0 || c.x1 <= c.x0 || c.y1 <= c.y0 ||
      c.x1 > film.width || c.y1 > film.height)
    throw InputError(fmt::format("--crop {}: expected x0,y0,x1,y1 inside 0,0,{},{}, the last two exclusive", o.crop,
                                 film.width, film.height));
  job.crop = c;
}

double parse_time() {
  if (o.time.empty()) return 0;
  double total = 0;
  const char* at = o.time.c_str();
  while (*at) {
    char* end = nullptr;
    const double value = std::strtod(at, &end);
    const char unit = *end;
    const double factor = unit == 'h' ? 3600 : unit == 'm' ? 60 : unit == 's' || unit == '\0' ? 1 : 0;
    if (end == at || factor == 0 || !(value >= 0)) {
      total = 0;
      break;
    }
    total += value * factor;
    at = unit ? end + 1 : end;
  }
  if (!(total > 0)) throw InputError(fmt::format("--time {}: expected a duration such as 90s, 10m or 1h30m", o.time));
  return total;
}

/// "64 samples per pixel", or how many where tiles have different numbers.
std::string samples_text(const RenderReport& report) {
  if (report.most_samples_per_pixel == report.samples_per_pixel)
    return fmt::format("{} samples per pixel", report.samples_per_pixel);
  return fmt::format("{} to {} samples per pixel, {:.1f} on average", report.samples_per_pixel,
                     report.most_samples_per_pixel, report.mean_samples_per_pixel);
}

/// What was reached of a target error.
void tell_error(const Common& common, const RenderReport& report, bool missed) {
  const std::string reached =
      std::isfinite(*report.error)
          ? fmt::format("estimated relative error {:.4g}", *report.error)
          : std::string("no error can be estimated: fewer than 8 samples per pixel, or no light was found");
  if (missed)
    warn(fmt::format("target error {} not reached with {}: {}", o.target_error, samples_text(report), reached));
  else
    log(common, reached);
}

/// Tells what is made up around a bare volume, and saves it where that is asked for.
void tell_assumptions(const Common& common, const VolumeScene& made) {
  for (const std::string& line : made.assumptions) log(common, "assumed " + line);
  if (o.save_scene.empty()) {
    log(common, "--save-scene FILE.toml keeps these as a scene to edit, -D KEY=VALUE changes one");
    return;
  }
  const fs::path path(o.scene), inputs[] = {path};
  check_writable(o.save_scene, inputs, ".toml");
  const auto folder = fs::absolute(o.save_scene).parent_path();
  write_text(o.save_scene, made.text(fs::proximate(path, folder).generic_string()));
}

/// A scene file, or what is made up around a bare volume.
/// @param made  around a sequence of volumes; null: there is none
Scene load_scene(const Common& common, const VolumeScene* made) {
  if (made) return parse_scene(made->text(fs::path(o.scene).filename().string()), o.scene, o.overrides);
  LoadedScene loaded = brume::load_scene(o.scene, o.overrides, {common.threads, {}, &interrupted});
  if (loaded.made)
    tell_assumptions(common, *loaded.made);
  else if (!o.save_scene.empty())
    throw InputError(fmt::format("--save-scene writes what is assumed about a bare volume; {} is a scene", o.scene));
  return std::move(loaded.scene);
}

/// Says what the clean picture's error is estimated to be.
void tell_clean_error(const Common& common, const Cleaner& cleaner, bool missed, const RenderReport& report) {
  const std::string reached = fmt::format("estimated relative error of the clean picture {:.4g}", cleaner.error());
  if (missed)
    warn(fmt::format("target error {} not reached with {}: {}", o.target_error, samples_text(report), reached));
  else
    log(common, reached);
}

/// Why a frame of a sequence that is resumed must be rendered, told where its file is there; nothing where it need not.
std::optional<std::string> why_to_render(const Common& common, const Scene& scene, const LayerRequest& layers,
                                         const RenderJob& job, const std::optional<Cleaner>& cleaner) {
  const Task task{common.threads, {}, &interrupted};
  RenderJob asked = job;
  asked.target_error = o.target_error;  // also where the clean picture's error ends the render
  const std::string wrong =
      what_is_unfinished(o.output, scene, layers, asked, cleaner ? &cleaner->filter() : nullptr, task);
  if (!wrong.empty()) return wrong;
  for (const std::string& beside : {o.preview, o.records})
    if (!beside.empty() && !fs::exists(beside)) return fmt::format("{} is not there", beside);
  return std::nullopt;
}

LayerRequest requested_layers() {
  return LayerRequest::of(o.layers.empty() || o.layers == "none" ? std::vector<std::string>{} : split(o.layers, ','),
                          !o.no_statistics, o.buckets);
}

/// Renders one picture.
/// @param made  as load_scene
int run(const Common& common, const VolumeScene* made = nullptr) {
  Scene scene = load_scene(common, made);
  std::vector<std::filesystem::path> inputs = {o.scene, scene.environment.file, scene.camera.from_exr};
  for (const VolumeSettings& volume : scene.volumes) inputs.push_back(volume.file);
  for (const SurfaceSettings& surface : scene.surfaces)
    inputs.insert(inputs.end(), {surface.file, surface.albedo_texture});
  if (!o.checkpoint.empty()) check_writable(o.checkpoint, inputs, ".exr");
  inputs.push_back(o.resume);
  if (!o.output.empty()) check_writable(o.output, inputs, ".exr");
  if (!o.preview.empty()) check_writable(o.preview, inputs, ".png");
  if (!o.records.empty()) check_writable(o.records, inputs, ".records");
  if (!o.output.empty() && !o.checkpoint.empty() &&
      std::filesystem::weakly_canonical(o.output) == std::filesystem::weakly_canonical(o.checkpoint))
    throw InputError(
        fmt::format("{}: is the checkpoint too, which the picture would replace; name another output", o.output));
  const bool open_ended = o.spp == 0 && (!o.time.empty() || o.target_error > 0);
  if (o.spp > 0) scene.render.spp = o.spp;
  if (open_ended) scene.render.spp = 1 << 20;  // as many as the time or the error asks for
  if (o.seed >= 0) scene.render.seed = o.seed;
  // A clean picture needs two of them, and what else there is would only be written.
  if (o.clean && !o.layers_given) o.layers = "direct,indirect";
  LayerRequest layers = requested_layers();
  layers.records = !o.records.empty();
  std::optional<Cleaner> cleaner;
  if (o.clean || !o.clean_filter.empty()) {
    if (!o.part.empty()) throw InputError("--clean: a part is cleaned once it is merged, by brume denoise");
    cleaner.emplace(
        o.clean_filter.empty() ? "transport_regression" : o.clean_filter, scene.film.exposure,
        [&](const std::string& filter) { return make_task(common, filter); }, note, o.outliers.chosen());
    layers = cleaner->request(layers, scene.render.spp);
    if (o.target_error > 0 && !cleaner->estimates_error())
      throw InputError(
          fmt::format("--target-error with --clean needs a filter that estimates its error, which {} does "
                      "not; take transport_regression",
                      o.clean_filter));
  }

  if (!cleaner && o.outliers.text != OutlierOption().text)
    throw InputError("--outliers is about what a filter gets; expected --clean");

  RenderJob job;
  job.spp = scene.render.spp;
  if (open_ended) job.guide_samples = kSamplesWithoutLimit;
  job.seed = scene.render.seed;
  parse_part(job);
  parse_crop(job, scene.film);
  job.time_limit = parse_time();
  job.target_error = cleaner ? 0 : o.target_error;
  job.checkpoint = o.checkpoint;
  job.checkpoint_seconds = o.checkpoint_every;
  job.resume = o.resume;
  job.records = o.records;
  // A checkpoint that is resumed is also where to go on checkpointing.
  if (!o.resume.empty() && o.checkpoint.empty()) job.checkpoint = o.resume;
  job.program = version_text();
  job.stamp = [](Layers& frame) { stamp(frame); };
  if (o.skip_complete) {
    const std::optional<std::string> why = why_to_render(common, scene, layers, job, cleaner);
    if (!why) return kSkipped;
    if (fs::exists(o.output)) warn(fmt::format("{} is rendered again: {}", o.output, *why));
    if (!o.checkpoint.empty() && fs::exists(o.checkpoint)) {
      const std::string forbids =
          what_forbids_resuming(o.checkpoint, scene, layers, job, {common.threads, {}, &interrupted});
      if (forbids.empty())
        job.resume = o.checkpoint;
      else
        warn(fmt::format("the checkpoint {} is left aside: {}", o.checkpoint, forbids));
    }
    job.checkpoint_at_end = false;
  }
  job.warn = [](const std::string& text) { warn("warning: " + text); };

  const PreparedScene prepared(scene, layers, {common.threads, {}, &interrupted});
  for (const std::string& text : prepared.notes()) note(text);
  if (o.explain) {
    print(prepared.explain(job.samples_for_guides(), {common.threads, {}, &interrupted}));
    return kDone;
  }
  if (!o.replay.empty()) return replay(prepared, scene.render.seed);
  if (o.output.empty()) throw InputError("no output; expected -o FILE.exr (or --explain)");
  std::unique_ptr<TevViewer> viewer;
  if (!o.tev.empty()) {
    const RenderJob::Crop c = job.crop.value_or(RenderJob::Crop{0, 0, scene.film.width, scene.film.height});
    viewer = std::make_unique<TevViewer>(o.tev == "default" ? "" : o.tev, scene.name, c.x1 - c.x0, c.y1 - c.y0);
    job.watch = [&](const Film& film, int tile) { viewer->update(film, tile); };
  }
  if (cleaner && (job.time_limit > 0 || o.target_error > 0))
    job.next_round = [&](const RenderRound& round) {
      NextRound next = cleaner->next_round(round, o.target_error);
      if (viewer) viewer->show(cleaner->picture());
      return next;
    };
  RenderResult result = prepared.render(job, make_task(common, "render " + scene.name));
  if (cleaner) {
    result.layers = cleaner->clean(result.layers);
    if (viewer) viewer->show(result.layers);
  }
  write_exr(o.output, result.layers);
  std::error_code ignored;
  if (o.skip_complete && !o.checkpoint.empty()) fs::remove(o.checkpoint, ignored);
  if (!o.preview.empty())
    o.picture.write(o.preview, result.layers, result.layers.rgb(layer::beauty),
                    choose_exposure(o.picture.exposure, result.layers));
  log(common, result.report.summary());
  const RenderReport& report = result.report;
  if (prepared.plan().has_media() && !prepared.plan().emission && report.counters.paths > 0 &&
      report.counters.tracking.collisions == 0)
    note("no path met the medium; does the camera look past it? 'brume info' tells where a volume lies");
  if (report.samples_per_pixel > scene.render.spp)
    note(fmt::format("the checkpoint held more samples per pixel, {}, than the {} asked for", report.samples_per_pixel,
                     scene.render.spp));
  if (cleaner) {
    if (open_ended) log(common, samples_text(report));
    log(common, fmt::format("cleaned in {:.2f} s", cleaner->seconds()));
    const bool missed = o.target_error > 0 && !(cleaner->error() <= o.target_error);
    if (cleaner->error() >= 0) tell_clean_error(common, *cleaner, missed, report);
    print(o.output + "\n");
    return missed ? kThresholdFailed : kDone;
  }
  if (open_ended) log(common, samples_text(report));
  const bool missed = o.target_error > 0 && !(report.error.value_or(0) <= o.target_error);
  if (o.target_error > 0) tell_error(common, report, missed);
  print(o.output + "\n");
  // One bad sample in a million is reported; more is a failure (docs/methods.md, Numerical rules).
  const double allowed = o.require_valid ? 0.0 : 1e-6 * static_cast<double>(result.report.counters.paths);
  return missed || static_cast<double>(result.report.invalid_samples) > allowed ? kThresholdFailed : kDone;
}

/// The options of one frame: its names, its number.
Options of_frame(const Options& sequence, int frame) {
  Options options = sequence;
  for (std::string Options::*name :
       {&Options::output, &Options::preview, &Options::records, &Options::checkpoint, &Options::resume})
    options.*name = file_of_frame(options.*name, frame).string();
  options.overrides.push_back(fmt::format("render.frame={}", frame));
  if (options.fixed_seed) options.overrides.push_back("render.noise_frame=0");
  return options;
}

/// The folder of an output may be named by the frame: then it is made.
void make_folder_of_frame(const std::string& pattern, int frame) {
  const fs::path folder = fs::path(pattern).parent_path();
  std::error_code ignored;  // told when the file is written
  if (FramePattern::of(folder)) fs::create_directory(file_of_frame(folder, frame), ignored);
}

int run_sequence(const Common& common) {
  const std::vector<int> frames = parse_frames(o.frames);
  if (o.output.empty()) throw InputError("no output; expected -o with a name such as shot.####.exr");
  if (o.explain || !o.replay.empty())
    throw InputError(fmt::format("{} looks at one frame; expected it without --frames, with -D render.frame={}",
                                 o.explain ? "--explain" : "--replay", frames[0]));
  for (const auto& [option, name] : {std::pair("-o", &o.output),
                                     {"--png", &o.preview},
                                     {"--records", &o.records},
                                     {"--checkpoint", &o.checkpoint},
                                     {"--resume", &o.resume}})
    check_pattern(option, *name, frames);
  // What is wrong with the options is told once, not for every frame.
  parse_time();
  RenderJob any;
  any.spp = std::numeric_limits<int>::max();
  parse_part(any);
  requested_layers();
  const Options sequence = o;
  // One camera for a sequence of bare volumes: what lies around the last one, which is the largest more often than not.
  const fs::path last = file_of_frame(o.scene, frames.back());
  std::optional<VolumeScene> made;
  if (is_volume(last)) {
    made = scene_for_volume(last, {common.threads, {}, &interrupted});
    tell_assumptions(common, *made);
  }
  return each_frame(common, frames, [&](int frame) {
    o = of_frame(sequence, frame);
    if (!made) o.scene = file_of_frame(sequence.scene, frame).string();
    for (const std::string& name : {sequence.output, sequence.preview, sequence.records, sequence.checkpoint})
      make_folder_of_frame(name, frame);
    const int end = run(common, made ? &*made : nullptr);
    return end == kSkipped ? FrameEnd::kSkipped : end == kDone ? FrameEnd::kDone : FrameEnd::kMissed;
  });
}

}  // namespace

void add_render(CLI::App& app, Common& common, Commands& commands) {
  const CLI::Validator above_zero(
      [](const std::string& text) {
        char* end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        return *end == '\0' && value > 0 ? std::string() : text + " is no number above 0";
      },
      "FLOAT > 0");
  CLI::App* command = add_command(app, common, "render", "render a scene, or a bare volume, to an EXR with layers");
  command->add_option("scene", o.scene, "scene file (TOML, see docs/scene.md), or an OpenVDB file")->required();
  command->add_flag("--clean", o.clean,
                    "clean the picture with noise-free guides; with --time or --target-error in rounds that put "
                    "samples where the clean picture needs them");
  command->add_option("--clean-filter", o.clean_filter,
                      "clean with this filter instead: NAME or NAME:parameter=value,...");
  o.outliers.add_to(*command);
  command->add_option("--save-scene", o.save_scene,
                      "of a bare volume: write the scene that is assumed, a TOML to edit");
  command->add_option("-o,--output,--outfile", o.output, "EXR to write");
  command->add_option("--png", o.preview, "also write the beauty as PNG");
  o.picture.add_to(*command,
                   "of the PNG: a number, header (the scene's), or auto: the 99th luminance percentile becomes 1");
  command->add_option("--spp", o.spp, "paths per pixel instead of the scene's")->check(CLI::Range(1, 1 << 24));
  command->add_option("--seed", o.seed, "seed instead of the scene's")->check(CLI::NonNegativeNumber);
  command->add_option("-D", o.overrides, "set a key of the scene: -D camera.fov=30")->allow_extra_args(false);
  command->add_option("--layers", o.layers, "layers to record, none, or all; with --clean direct,indirect unless given")
      ->capture_default_str();
  command->add_flag("--no-statistics", o.no_statistics, "leave out mean_variance, half_a and half_b");
  command->add_flag("--buckets", o.buckets, "record eight bucket means of each layer too");
  command->add_option("--crop", o.crop,
                      "render only x0,y0,x1,y1 [px, the last two exclusive], same pixels as in the whole");
  command->add_option("--time", o.time,
                      "stop after this long, at a whole pass: 90s, 10m, 1h30m; what is resumed counts");
  command
      ->add_option(
          "--target-error", o.target_error,
          "stop at this estimated relative error: root of the mean of variance / (mean^2 + 0.01 white^2); with --clean "
          "that of the clean picture")
      ->check(above_zero);
  command->add_option("--checkpoint", o.checkpoint, "EXR to keep the state in, while rendering and after");
  command->add_option("--checkpoint-every", o.checkpoint_every, "seconds between checkpoints")
      ->check(above_zero)
      ->capture_default_str();
  command
      ->add_option("--resume", o.resume,
                   "go on from a checkpoint FILE.exr, also with more --spp; same picture as in one go. Alone, with "
                   "--frames: leave out the frames that are complete, and go on from the --checkpoint of the others, "
                   "which is removed when its frame is there")
      ->expected(0, 1)
      ->default_str(kResumeFrames);
  command->add_option("--frames", o.frames,
                      "render these: 7, 1-240, 1-240x2, or several with commas between; names with ####, $F4 or %04d "
                      "become each frame's, also the scene's and those in it; a frame that fails is named and the rest "
                      "goes on");
  command->add_flag("--fixed-seed", o.fixed_seed,
                    "with --frames: the same random numbers in every frame, whose noise then stands still");
  command->add_option("--part", o.part, "i/N: the i-th of N shares of the samples, to be joined by brume merge");
  command->add_option("--records", o.records,
                      "also write what happened to each sample (random numbers, positions, colours) to FILE.records");
  command->add_option("--tev", o.tev, "show the picture in tev as it grows, at host:port; alone: at 127.0.0.1:14158")
      ->expected(0, 1)
      ->default_str("default");
  command->add_flag("--explain", o.explain, "print what would be modelled and what it costs, and stop");
  command->add_flag("--require-valid", o.require_valid,
                    "exit with 1 when any sample was not finite (else above one in a million)");
  command->add_option("--replay", o.replay, "trace one sample again and print it: x,y,sample");
  commands[command] = [&common, command] {
    o.layers_given = command->count("--layers") > 0;
    o.skip_complete = o.resume == kResumeFrames;
    if (o.skip_complete) o.resume.clear();
    if (!o.frames.empty()) return run_sequence(common);
    if (o.skip_complete) throw InputError("--resume needs the checkpoint to go on from, or --frames");
    if (o.fixed_seed) throw InputError("--fixed-seed is for --frames: one frame has one seed");
    return run(common);
  };
}

}  // namespace brume::app
