#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "apps/cli/command.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "render/world/volume_scene.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

constexpr int kUnknownSamples = 16;

struct Options {
  std::string like, volume, scene, output, frames;
  int samples = 0;
  std::vector<std::string> overrides;
  bool explain = false;
};

bool has_camera(const ExrInfo& info) {
  return info.header.contains("worldToCamera") && info.header.contains("worldToNDC");
}

/// What the frame and the command line say of the scene.
std::vector<std::string> overrides_for(const Options& o, const ExrInfo& like) {
  std::vector<std::string> overrides = {fmt::format("film.width={}", like.width),
                                        fmt::format("film.height={}", like.height)};
  if (!o.scene.empty() && !o.volume.empty()) overrides.push_back("volumes.0.file=" + fs::absolute(o.volume).string());
  overrides.insert(overrides.end(), o.overrides.begin(), o.overrides.end());
  return overrides;
}

/// The fingerprint that a render of the scene has, seen by its own camera; empty where it has none.
std::string own_hash(const Options& o, const ExrInfo& like) {
  if (o.scene.empty()) return "";
  try {
    return read_scene(o.scene, overrides_for(o, like)).hash;
  } catch (const InputError&) {
    return "";  // a scene of lights and media alone
  }
}

/// The scene, or what is made up around the volume, seen as the frame was.
Scene scene_like(const Options& o, const Common& common, const ExrInfo& like) {
  std::vector<std::string> overrides = overrides_for(o, like);
  if (has_camera(like)) {
    overrides.insert(overrides.begin(), "camera.from_exr=" + fs::absolute(o.like).string());
    log(common, fmt::format("camera: of {}'s header", o.like));
  }
  if (!o.scene.empty()) {
    if (!has_camera(like)) log(common, fmt::format("camera: of {}, since {}'s header has none", o.scene, o.like));
    return read_scene(o.scene, overrides);
  }
  if (o.volume.empty())
    throw InputError("neither --volume nor --scene: guides need what the frame shows, and what lights it");
  if (!has_camera(like))
    throw InputError(fmt::format(
        "{}: no camera in its header (worldToCamera and worldToNDC); write it into the [camera] of a scene and give that with --scene",
        o.like));
  const VolumeScene made = scene_for_volume(o.volume, {common.threads, {}, &interrupted});
  for (const std::string& line : made.assumptions) log(common, "assumed " + line);
  note("what lights the volume is assumed: guides of the frame's own lights, in --scene, know more");
  return parse_scene(made.text(fs::absolute(o.volume).string()), o.volume, overrides);
}

int run(const Options& o, const Common& common) {
  read_exr(o.like, [](const std::string&) { return false; });  // refuses deep pixels, whose headers alone can be read
  const ExrInfo like = read_exr_info(o.like);
  const Scene scene = scene_like(o, common, like);
  std::vector<fs::path> inputs = {o.like, o.scene, o.volume};
  for (const VolumeSettings& volume : scene.volumes) inputs.push_back(volume.file);
  check_writable(o.output, inputs, ".exr");

  const Task task{common.threads, {}, &interrupted};
  LayerRequest layers;
  layers.names = {};
  layers.guides = true;
  const PreparedScene prepared(scene, layers, task);
  for (const std::string& text : prepared.notes()) note(text);
  int samples = o.samples;
  if (const auto found = like.header.find("samplesPerPixel"); samples == 0 && found != like.header.end())
    if (const int* const n = std::get_if<int>(&found->second)) samples = *n;
  if (samples <= 0) samples = kUnknownSamples;
  if (o.explain) print(prepared.explain(samples, task));

  const Camera camera = prepared.camera();
  Layers frame(like.data.width(), like.data.height());
  if (like.data != like.display || like.display.lo != ivec2(0)) {
    frame.origin = like.data.lo;
    frame.display_origin = like.display.lo;
    frame.display = like.display.hi - like.display.lo;
  }
  prepared.guides(samples, make_task(common, "light of " + scene.name))
      ->record(camera, like.data.lo - like.display.lo, frame, make_task(common, "guides of " + scene.name));
  if (frame.channels().empty())
    throw InputError(fmt::format("{}: nothing in it scatters or glows", o.scene.empty() ? o.volume : o.scene));
  frame.header["scene"] = scene.name;
  frame.header["guidesOf"] = fs::path(o.like).filename().string();
  frame.header["guidesFingerprint"] = scene.hash;
  if (const std::string hash = own_hash(o, like); !hash.empty()) frame.header["sceneHash"] = hash;
  frame.header["worldToCamera"] = camera.world_to_camera();
  frame.header["worldToNDC"] = camera.world_to_ndc();
  stamp(frame);
  write_exr(o.output, frame, task);
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
  CLI::App* command =
      add_command(app, common, "guides", "compute guides for a frame of any renderer: denoise --guides takes them");
  command->add_option("--like", o.like, "the EXR they are for: its size, and its camera where its header has one")
      ->required();
  command->add_option("--scene", o.scene, "TOML with lights, media and, where the frame's header has none, the camera");
  command->add_option("--volume", o.volume,
                      "OpenVDB file: instead of the scene's first one, or with assumed coefficients and lights");
  command->add_option("-o,--output", o.output, "EXR to write")->required();
  command->add_option(
      "--frames", o.frames,
      "guides of these: 7, 1-240, 1-240x2, or several with commas between; names with ####, $F4 or %04d become each frame's, also the volumes' in the scene; a frame that fails is named and the rest goes on");
  command
      ->add_option("--spp", o.samples,
                   "samples per pixel of the frame: more of them deserve guides in more detail; else its header's")
      ->check(CLI::Range(1, 1 << 24));
  command->add_option("-D", o.overrides, "set a key of the scene: -D volumes.0.sigma_t=18")->allow_extra_args(false);
  command->add_flag("--explain", o.explain, "say what is solved, and with how much memory and time");
  commands[command] = [options, &common] {
    return options->frames.empty() ? run(*options, common) : run_sequence(*options, common);
  };
}

}  // namespace brume::app
