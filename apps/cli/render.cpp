#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/filter_options.h"
#include "apps/cli/frame.h"
#include "apps/cli/tev.h"
#include "base/error.h"
#include "base/sequence.h"
#include "base/text.h"
#include "workflows/render_frame.h"

namespace brume::app {
namespace {

constexpr const char* kResumeFrames = "frames";  // --resume without a file

struct Options {
  RenderOptions render;
  std::string layers = "direct,indirect,gradient,coverage,transmittance", part, time, replay, tev, frames, clean_filter;
  int spp = 0;
  int64_t seed = -1;
  bool clean = false, no_statistics = false, buckets = false, explain = false;
  std::string outliers = "extreme";
};

RenderOptions::Part parse_part(const std::string& text) {
  RenderOptions::Part part{};
  int used = 0;
  if (std::sscanf(text.c_str(), "%d/%d%n", &part.number, &part.parts, &used) != 2 ||
      static_cast<size_t>(used) != text.size() || part.number < 1 || part.number > part.parts)
    throw InputError(fmt::format("--part {}: expected i/N, for example 2/4, with i from 1 to N", text));
  return part;
}

double parse_time(const std::string& text) {
  double total = 0;
  const char* at = text.c_str();
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
  if (!(total > 0)) throw InputError(fmt::format("--time {}: expected a duration such as 90s, 10m or 1h30m", text));
  return total;
}

/// What the command line asks for. @throws InputError
RenderOptions parsed(const Options& o) {
  RenderOptions options = o.render;
  if (o.spp > 0) options.spp = o.spp;
  if (o.seed >= 0) options.seed = o.seed;
  options.layers =
      LayerRequest::of(o.layers.empty() || o.layers == "none" ? std::vector<std::string>{} : split(o.layers, ','),
                       !o.no_statistics, o.buckets);
  if (o.clean || !o.clean_filter.empty())
    options.clean_filter = o.clean_filter.empty() ? "transport_regression" : o.clean_filter;
  else if (o.outliers != Options().outliers)
    throw InputError("--outliers is about what a filter gets; expected --clean");
  options.outliers = kOutlierRules.of(o.outliers);
  if (!o.part.empty()) options.part = parse_part(o.part);
  if (!o.time.empty()) options.time_limit = parse_time(o.time);
  if (!o.tev.empty())
    options.watch = [address = o.tev == "default" ? "" : o.tev](const std::string& name, ivec2 size) {
      return std::make_unique<TevViewer>(address, name, size.x, size.y);
    };
  return options;
}

std::vector<int> frames_of(const Options& o) {
  const bool one = o.explain || !o.replay.empty();
  return frames_to_make(o.render.scene, one ? "" : o.render.output, o.frames, {"-o", "--frames"});
}

int run_sequence(const Options& o, const std::vector<int>& frames, const RenderOptions& options, const Host& host) {
  if (options.output.empty()) throw InputError("no output; expected -o with a name such as shot.####.exr");
  if (o.explain || !o.replay.empty())
    throw InputError(fmt::format("{} looks at one frame; expected it without --frames, with -D render.frame={}",
                                 o.explain ? "--explain" : "--replay", frames[0]));
  for (const auto& [option, name] : {std::pair("-o", &options.output),
                                     {"--png", &options.preview},
                                     {"--deep", &options.deep},
                                     {"--records", &options.records},
                                     {"--checkpoint", &options.checkpoint},
                                     {"--resume", &options.resume}})
    check_pattern(option, *name, frames);
  return status_of(render_sequence(options, frames, host));
}

int run(const Options& o, const Common& common) {
  const RenderOptions options = parsed(o);
  const Host host = make_host(common);
  if (const std::vector<int> frames = frames_of(o); !frames.empty()) return run_sequence(o, frames, options, host);
  if (options.skip_complete) throw InputError("--resume needs the checkpoint to go on from, or --frames");
  if (options.fixed_seed) throw InputError("--fixed-seed is for --frames: one frame has one seed");
  if (o.explain || !o.replay.empty()) {
    print(o.explain ? explain_render(options, host) : replay_sample(options, o.replay, host));
    return kDone;
  }
  if (options.output.empty()) throw InputError("no output; expected -o FILE.exr (or --explain)");
  return status_of(render_frame(options, host).end);
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
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  RenderOptions& r = o.render;
  const Verb command = add_command(app, common, "render", "render a scene, or a bare volume, to an EXR with layers");
  command("scene", r.scene, "scene file (TOML, see docs/scene.md), or an OpenVDB file")->required();
  command(
      "--clean", o.clean,
      "clean the picture with noise-free guides; with --time or --target-error in rounds that put samples where the clean picture needs them");
  command("--clean-filter", o.clean_filter, "clean with this filter instead: NAME or NAME:parameter=value,...");
  add_outlier_option(command, o.outliers);
  command("--save-scene", r.save_scene, "of a bare volume: write the scene that is assumed, a TOML to edit");
  command("-o,--output,--outfile", r.output, "EXR to write");
  command("--png", r.preview, "also write the beauty as PNG");
  command("--deep", r.deep,
          "also write a deep EXR: the picture, clean with --clean, in samples at their depths along the camera's axis; "
          "the frame's alpha becomes its own, which has no noise");
  command("--deep-samples", r.deep_samples, "samples of each deep pixel, at most")
      ->check(CLI::Range(1, 4096))
      ->capture_default_str();
  command("--deep-float", r.deep_float, "float colours in the deep EXR instead of half ones");
  add_picture_options(command, r.picture,
                      "of the PNG: a number, header (the scene's), or auto: the 99th luminance percentile becomes 1");
  command("--spp", o.spp, "paths per pixel instead of the scene's")->check(CLI::Range(1, 1 << 24));
  command("--seed", o.seed, "seed instead of the scene's")->check(CLI::NonNegativeNumber);
  command("-D", r.overrides, "set a key of the scene: -D camera.fov=30")->allow_extra_args(false);
  add_size_option(command, r.overrides);
  command(
      "--layers", o.layers,
      "layers to record, none, or all; guides, depths, light_parts and cryptomatte are several; with --clean direct,indirect unless given")
      ->capture_default_str();
  command("--no-statistics", o.no_statistics, "leave out mean_variance, half_a and half_b");
  command("--buckets", o.buckets, "record eight bucket means of each layer too");
  command("--crop", r.crop, "render only x0,y0,x1,y1 [px, the last two exclusive], same pixels as in the whole");
  command("--time", o.time, "stop after this long, at a whole pass: 90s, 10m, 1h30m; what is resumed counts");
  command(
      "--target-error", r.target_error,
      "stop at this estimated relative error: root of the mean of variance / (mean^2 + 0.01 white^2); with --clean that of the clean picture")
      ->check(above_zero);
  command(
      "--updates", r.updates,
      "EXR of the picture while it is rendered, first after one sample per pixel, then clean with --clean; each replaces the one before as a whole and is told, with --progress json as a line with its name, samples and estimated error. The result stays the same");
  command("--checkpoint", r.checkpoint, "EXR to keep the state in, while rendering and after");
  command("--checkpoint-every", r.checkpoint_seconds, "seconds between checkpoints")
      ->check(above_zero)
      ->capture_default_str();
  command(
      "--resume", r.resume,
      "go on from a checkpoint FILE.exr, also with more --spp; same picture as in one go. Alone, with --frames: leave out the frames that are complete, and go on from the --checkpoint of the others, which is removed when its frame is there")
      ->expected(0, 1)
      ->default_str(kResumeFrames);
  command(
      "--frames", o.frames,
      "render these: 7, 1-240, 1-240x2, or several with commas between; names with ####, $F4 or %04d become each frame's, also the scene's and those in it; a frame that fails is named and the rest goes on");
  command("--fixed-seed", r.fixed_seed,
          "with --frames: the same random numbers in every frame, whose noise then stands still");
  command("--part", o.part, "i/N: the i-th of N shares of the samples, to be joined by brume merge");
  command("--records", r.records,
          "also write what happened to each sample (random numbers, positions, colours) to FILE.records");
  command("--tev", o.tev, "show the picture in tev as it grows, at host:port; alone: at 127.0.0.1:14158")
      ->expected(0, 1)
      ->default_str("default");
  command("--explain", o.explain, "print what would be modelled and what it costs, and stop");
  command("--require-valid", r.require_valid,
          "exit with 1 when any sample was not finite (else above one in a million)");
  command("--replay", o.replay, "trace one sample again and print it: x,y,sample");
  commands[command] = [options, &common, command] {
    if (options->clean && command->count("--layers") == 0)
      options->layers =
          "direct,indirect";  // a clean picture needs two of them, and what else there is would be written
    RenderOptions& render = options->render;
    render.skip_complete = render.resume == kResumeFrames;
    if (render.skip_complete) render.resume.clear();
    return run(*options, common);
  };
}

}  // namespace brume::app
