#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/frame.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_outline.h"
#include "workflows/frame_lights.h"
#include "workflows/mix_text.h"

namespace brume::app {
namespace {

struct Options {
  std::string frame, gain, mix, map, output, preview, scene, save_scene;
  std::vector<std::string> colours;
  PictureOptions picture;
};

/// The scene beside its mix, with lights as the mix has them.
void save_scene(const Options& o, const LightMix& mix) {
  const std::filesystem::path inputs[] = {o.scene};
  check_writable(o.save_scene, inputs, ".toml");
  const std::string text = read_scene_text(o.scene);
  write_text(o.save_scene, edited_scene(text, o.scene, assignments_of_mix(text, o.scene, mix)));
}

int run(const Options& o, const Common& common) {
  if (o.scene.empty() != o.save_scene.empty())
    throw InputError("--scene and --save-scene belong together: the scene that was rendered, and where its mix goes");
  LightMix mix = o.mix.empty() ? LightMix() : read_mix(o.mix);
  for (const std::string& gain : o.gain.empty() ? std::vector<std::string>{} : split(o.gain, ','))
    add_to_mix(mix, gain);
  for (const std::string& colour : o.colours) add_to_mix(mix, colour);
  const std::filesystem::path inputs[] = {o.frame};
  check_writable(o.output, inputs, ".exr");
  if (!o.preview.empty()) o.picture.check();
  const Host host = make_host(common);
  const ExrFile file(o.frame);
  Layers mixed;
  try {
    mixed = mixed_frame(file, o.map, mix, host);
  } catch (const InputError& error) {
    throw InputError(o.frame + ": " + error.what());
  }
  if (!o.save_scene.empty()) save_scene(o, mix);
  write_exr(o.output, mixed, host.silent());
  if (!o.preview.empty()) o.picture.write(o.preview, mixed);
  print(o.output + "\n");
  return kDone;
}

}  // namespace

void add_mix(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command = add_command(app, common, "mix", "other lights in a frame with light groups, without rendering");
  command("frame", o.frame, "EXR with layers light.GROUP, clean or not, or with the light groups of another renderer")
      ->required();
  command("--gain", o.gain, "brightness of groups: key=2,rim=0");
  command("--colour,--color", o.colours, "colours that groups are multiplied by: fill=1,.8,.6 rim=.5,.5,1");
  command("--mix", o.mix, "TOML with a table [mix], as brume view saves it; --gain and --colour multiply what it says");
  command("--map", o.map, "TOML file that says which layer of another renderer's frame plays which part");
  command("-o,--output", o.output, "EXR to write")->required();
  command("--png", o.preview, "a PNG of it, too");
  add_picture_options(command, o.picture,
                      "of the PNG: number, header, or auto: the 99th luminance percentile becomes 1");
  command("--scene", o.scene, "the scene that was rendered");
  command("--save-scene", o.save_scene, "TOML to write: the same scene with its lights as they are mixed");
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
