#include <limits>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/frame.h"
#include "base/output_file.h"
#include "image/exr_io.h"
#include "workflows/deep_frame.h"
#include "workflows/frame.h"

namespace brume::app {
namespace {

struct Options {
  std::string deep, output, preview;
  PictureOptions picture;
  float before = std::numeric_limits<float>::infinity();
};

int run(const Options& o, const Common& common) {
  const std::filesystem::path inputs[] = {o.deep};
  check_writable(o.output, inputs, ".exr");
  if (!o.preview.empty()) o.picture.check();
  const Host host = make_host(common);
  const Layers flat = flattened_file(o.deep, o.before, host);
  write_exr(o.output, flat, host.silent());
  if (!o.preview.empty()) o.picture.write(o.preview, flat);
  print(o.output + "\n");
  return kDone;
}

}  // namespace

void add_flatten(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command = add_command(app, common, "flatten", "the flat picture of a deep EXR, by any program");
  command("deep", o.deep, "EXR with deep scan lines or tiles")->required();
  command("-o,--output", o.output, "EXR to write")->required();
  command("--before", o.before, "only what is in front of this depth, as a holdout there leaves it [scene units]");
  command("--png", o.preview, "a PNG of it, too");
  add_picture_options(command, o.picture,
                      "of the PNG: number, header, or auto: the 99th luminance percentile becomes 1");
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
