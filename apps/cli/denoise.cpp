#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/filter_options.h"
#include "apps/cli/frame.h"
#include "apps/cli/video.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "filters/api/registry.h"
#include "workflows/denoise_frame.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

constexpr int kAsTheFilter = -1;  // --extra-frames is not given

struct Options {
  FrameFiles files;
  DenoiseOptions denoise;
  std::vector<std::string> filters;
  std::string component = "all", background = "default", noise = "layers", outliers = "extreme", features, carry;
  std::string frames, video;
  int extra_frames = kAsTheFilter;
  double frame_rate = 24;
};

/// What the command line asks for. @throws InputError
DenoiseOptions parsed(const Options& o) {
  DenoiseOptions options = o.denoise;
  for (const std::string& text : o.filters) options.filters.push_back(parse_filter(text));
  options.how.component = kComponents.of(o.component);
  options.how.background = kBackgrounds.of(o.background);
  options.how.noise = kNoiseSources.of(o.noise);
  options.how.outliers = kOutlierRules.of(o.outliers);
  if (!o.features.empty()) options.how.features = split(o.features, ',');
  if (!o.carry.empty())
    for (const std::string& name : split(o.carry, ',')) options.how.carried.push_back(kColourLayers.of(name));
  if (o.extra_frames != kAsTheFilter) options.extra_frames = o.extra_frames;
  return options;
}

int run_sequence(const Options& o, const std::vector<int>& frames, const DenoiseOptions& options, const Host& host) {
  const FrameFiles& names = o.files;
  for (const auto& [option, name] : {std::pair("FRAME", &names.frame),
                                     {"--second", &names.second},
                                     {"-o", &names.output},
                                     {"--png", &names.preview}})
    check_pattern(option, *name, frames);
  if (!o.video.empty()) {
    if (names.preview.empty())
      throw InputError("--video is made from the PNGs; expected --png with a name such as clean.####.png");
    if (o.filters.size() > 1) throw InputError("--video shows one filter's frames; name one with -f");
    check_writable(o.video, {}, "");
  }
  const int status = status_of(denoise_sequence(names, frames, options, host));
  if (o.video.empty()) return status;
  std::vector<fs::path> pictures;
  for (const int frame : frames)
    if (const fs::path picture = file_of_frame(names.preview, frame); fs::exists(picture)) pictures.push_back(picture);
  if (write_video(o.video, pictures, o.frame_rate)) print(o.video + "\n");
  return status;
}

int run(const Options& o, const Common& common) {
  const DenoiseOptions options = parsed(o);
  const Host host = make_host(common);
  const std::vector<int> frames = frames_or_all_of(o.files.frame, o.frames);
  if (!frames.empty()) return run_sequence(o, frames, options, host);
  if (options.resume) throw InputError("--resume leaves out the complete frames of a sequence; expected --frames");
  if (!o.video.empty()) throw InputError("--video shows the frames of a sequence; expected --frames");
  denoise_frame(o.files, options, host);
  return kDone;
}

void add_file_options(const Verb& command, FileOptions& file) {
  command("--keep-file", file.keep,
          "give the file back as it is but for what was cleaned: done by itself for frames of other renderers");
  command("--suffix", file.suffix,
          "add clean layers beside the noisy ones, under their names with this behind: _clean");
  command("--map", file.map, "TOML file that says which layer of another renderer's frame plays which part");
  command("--samples", file.samples, "samples per pixel of another renderer's frame that does not say it in its header")
      ->check(CLI::Range(1, 1 << 30));
}

std::string filter_help() {
  std::string text = "Filters, what serves best first, and their parameters:\n";
  for (const FilterEntry* e : filters_by_merit()) {
    text += fmt::format("  {}: {}\n", e->name, e->summary);
    const FilterSettings settings(*e);
    for (const Parameter& p : e->parameters)
      text += fmt::format("    --{:<20} {} ({}; default {})\n", p.name, p.help, p.range(),
                          Parameter::text(settings.get(p)));
  }
  return text;
}

}  // namespace

void add_denoise(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command =
      add_command(app, common, "denoise", "clean a frame, with the best filter for it or with those named");
  command("frame", o.files.frame, "EXR with layers, by brume or another renderer")->required();
  command(
      "-f,--filter", o.filters,
      "filter NAME instead of the best that the frame's layers allow; its parameters follow as NAME --PARAMETER VALUE or in NAME:parameter=value,...; repeat for several")
      ->allow_extra_args(false);
  command("-o,--output", o.files.output, "EXR to write; with several filters OUT.FILTER.exr each")->required();
  command("--png", o.files.preview, "also write a PNG");
  command(
      "--second", o.files.second,
      "EXR of the same frame by another seed, of any renderer: the mean of both is cleaned, and the two are the halves that show its noise");
  add_file_options(command, o.denoise.file);
  command("--guides", o.files.guides,
          "EXR with guides of this frame, by brume guides: what is known of the light without noise");
  add_component_options(command, o.component, o.background);
  command("--features", o.features,
          "of those that the frame has, use these: " + join(FeaturePlan::names(), ",") + ", or none");
  command("--noise", o.noise, "where variance comes from: the frame's layers, or the picture itself")
      ->check(one_of(kNoiseSources))
      ->capture_default_str();
  add_outlier_option(command, o.outliers);
  command("--carry", o.carry,
          "layers to filter with the same weights, so that passes still add up: direct,indirect,emission,...");
  command("--records", o.files.records, "record of every sample, for filters that read it");
  command(
      "--extra-frames", o.extra_frames,
      "frames before and after to look into, found by the number in the file's name, for filters that clean sequences; records and guides are found likewise. With --frames, unless given: as many as the filter declares (docs/filters.md)")
      ->check(CLI::Range(0, 100));
  command(
      "--frames", o.frames,
      "clean these: 7, 1-240, 1-240x2, or several with commas between; names with ####, $F4 or %04d stand for the files of each. Without this option all frames of such a name that are there are cleaned. A frame that fails is named, and the others go on");
  command("--resume", o.denoise.resume, "with --frames: leave out those that are there, whole, made from the same");
  command("--video", o.video, "with --frames and --png: also a film of the PNGs, where ffmpeg is there");
  command("--frame-rate", o.frame_rate, "of the film [1/s]")->check(CLI::Range(1.0, 1000.0))->capture_default_str();
  command("--tile", o.denoise.how.tile, "side of the squares that are filtered one after another [px]; 0: by memory")
      ->check(CLI::Range(0, 1 << 20));
  add_picture_options(
      command, o.denoise.picture,
      "from radiance to display, for the PNG and filters that compare colours as seen: a number, header, or auto");
  command->footer(filter_help);
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
