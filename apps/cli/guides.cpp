#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "apps/cli/command.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "workflows/guide_frame.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string like, volume, scene, output, frames;
  int samples = 0;
  std::vector<std::string> overrides;
  bool explain = false;
};

int run(const Options& o, const Common& common) {
  if (o.scene.empty() && o.volume.empty())
    throw InputError("neither --volume nor --scene: guides need what the frame shows, and what lights it");
  const Host host = make_host(common);
  GuideOptions options;
  options.like = GuidedFrame::of_file(o.like);
  if (!o.scene.empty()) {
    options.scene.emplace();
    options.scene->path = o.scene;
    options.scene->text = read_scene_text(o.scene);
  }
  options.volume = o.volume;
  options.overrides = o.overrides;
  options.samples = o.samples;
  options.explain = o.explain;
  const Scene scene = guided_scene(options, host);
  std::vector<fs::path> inputs = {o.like, o.scene, o.volume};
  for (const VolumeSettings& volume : scene.volumes) inputs.push_back(volume.file);
  check_writable(o.output, inputs, ".exr");
  const GuideFrame guides = guide_frame(scene, options, host);
  print(guides.explanation);
  write_exr(o.output, guides.layers, host.silent());
  print(o.output + "\n");
  return kDone;
}

int run_sequence(const Options& o, const Common& common) {
  const std::vector<int> frames = parse_frames(o.frames);
  if (o.explain)
    throw InputError(
        fmt::format("--explain looks at one frame; expected it without --frames, with -D render.frame={}", frames[0]));
  for (const auto& [option, name] : {std::pair("--like", &o.like), {"-o", &o.output}})
    check_pattern(option, *name, frames);
  return status_of(each_frame(frames, make_host(common), [&](int frame) {
    Options own = o;
    for (std::string Options::*name : {&Options::like, &Options::scene, &Options::volume, &Options::output})
      own.*name = file_of_frame(o.*name, frame).string();
    own.overrides.push_back(fmt::format("render.frame={}", frame));
    run(own, common);
    return FrameEnd::kDone;
  }));
}

}  // namespace

void add_guides(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command =
      add_command(app, common, "guides", "compute guides for a frame of any renderer: denoise --guides takes them");
  command("--like", o.like, "the EXR they are for: its size, and its camera where its header has one")->required();
  command("--scene", o.scene, "TOML with lights, media and, where the frame's header has none, the camera");
  command("--volume", o.volume,
          "OpenVDB file: instead of the scene's first one, or with assumed coefficients and lights");
  command("-o,--output", o.output, "EXR to write")->required();
  command(
      "--frames", o.frames,
      "guides of these: 7, 1-240, 1-240x2, or several with commas between; names with ####, $F4 or %04d become each frame's, also the volumes' in the scene; a frame that fails is named and the rest goes on");
  command("--spp", o.samples,
          "samples per pixel of the frame: more of them deserve guides in more detail; else its header's")
      ->check(CLI::Range(1, 1 << 24));
  command("-D", o.overrides, "set a key of the scene: -D volumes.0.sigma_t=18")->allow_extra_args(false);
  command("--explain", o.explain, "say what is solved, and with how much memory and time");
  commands[command] = [options, &common] {
    return options->frames.empty() ? run(*options, common) : run_sequence(*options, common);
  };
}

}  // namespace brume::app
