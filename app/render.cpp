#include <fmt/format.h>

#include <filesystem>

#include "app/command.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "image/picture_io.h"
#include "render/renderer.h"
#include "render/scene_io.h"

namespace brume::app {
namespace {

struct Options {
  std::string scene, output, preview, layers = "direct,indirect,gradient,coverage,transmittance", replay;
  std::vector<std::string> overrides;
  int spp = 0;
  int64_t seed = -1;
  bool no_statistics = false, explain = false, require_valid = false;
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
  print(fmt::format("direct {} {} {}\nindirect {} {} {}\ngradient {} {} {}\ncoverage {}\ntransmittance {}\n",
                    s.direct.x, s.direct.y, s.direct.z, s.indirect.x, s.indirect.y, s.indirect.z, s.gradient.x,
                    s.gradient.y, s.gradient.z, s.coverage, s.transmittance));
  return kDone;
}

int run(const Common& common) {
  Scene scene = read_scene(o.scene, o.overrides);
  std::vector<std::filesystem::path> inputs = {o.scene, scene.environment.file};
  for (const VolumeSettings& volume : scene.volumes) inputs.push_back(volume.file);
  if (!o.output.empty()) check_writable(o.output, inputs, ".exr");
  if (!o.preview.empty()) check_writable(o.preview, inputs, ".png");
  if (o.spp > 0) scene.render.spp = o.spp;
  if (o.seed >= 0) scene.render.seed = o.seed;
  const LayerRequest layers = LayerRequest::of(
      o.layers.empty() || o.layers == "none" ? std::vector<std::string>{} : split(o.layers, ','), !o.no_statistics);
  const PreparedScene prepared(scene, layers, {common.threads, {}, &interrupted});
  for (const std::string& note : prepared.notes()) warn("note: " + note);
  if (o.explain) {
    print(prepared.explain());
    return kDone;
  }
  if (!o.replay.empty()) return replay(prepared, scene.render.seed);
  if (o.output.empty()) throw InputError("no output; expected -o FILE.exr (or --explain)");
  RenderResult result = prepared.render(scene.render.spp, scene.render.seed, make_task(common, "render " + scene.name));
  stamp(result.layers);
  write_exr(o.output, result.layers);
  if (!o.preview.empty()) write_png(o.preview, to_picture(result.layers.rgb(layer::beauty), scene.film.exposure));
  log(common, result.report.summary());
  print(o.output + "\n");
  // One bad sample in a million is reported; more is a failure (TRANSPORT.md section 10).
  const double allowed = o.require_valid ? 0.0 : 1e-6 * static_cast<double>(result.report.counters.paths);
  return static_cast<double>(result.report.invalid_samples) > allowed ? kThresholdFailed : kDone;
}

}  // namespace

void add_render(CLI::App& app, Common& common, Commands& commands) {
  CLI::App* command = add_command(app, common, "render", "render a scene to an EXR with layers");
  command->add_option("scene", o.scene, "scene file (TOML, see docs/scene.md)")->required();
  command->add_option("-o,--output,--outfile", o.output, "EXR to write");
  command->add_option("--png", o.preview, "also write the beauty as PNG, with the scene's exposure");
  command->add_option("--spp", o.spp, "paths per pixel instead of the scene's")->check(CLI::Range(1, 1 << 24));
  command->add_option("--seed", o.seed, "seed instead of the scene's")->check(CLI::NonNegativeNumber);
  command->add_option("-D", o.overrides, "set a key of the scene: -D camera.fov=30")->allow_extra_args(false);
  command->add_option("--layers", o.layers, "layers to record, or none")->capture_default_str();
  command->add_flag("--no-statistics", o.no_statistics, "leave out mean_variance, half_a and half_b");
  command->add_flag("--explain", o.explain, "print what would be modelled and what it costs, and stop");
  command->add_flag("--require-valid", o.require_valid,
                    "exit with 1 when any sample was not finite (else above one in a million)");
  command->add_option("--replay", o.replay, "trace one sample again and print it: x,y,sample");
  commands[command] = [&common] { return run(common); };
}

}  // namespace brume::app
