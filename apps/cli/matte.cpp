#include <memory>

#include "apps/cli/command.h"
#include "base/error.h"
#include "base/output_file.h"
#include "image/exr_io.h"
#include "workflows/matte_frame.h"

namespace brume::app {
namespace {

struct Options {
  std::string frame, layer, output;
  std::vector<std::string> names;
};

int run(const Options& o, const Common& common) {
  const std::filesystem::path inputs[] = {o.frame};
  const bool png = std::filesystem::path(o.output).extension() == ".png";
  check_writable(o.output, inputs, png ? ".png" : ".exr");
  const Layers matte = matte_of_file(o.frame, o.names, o.layer);
  if (png)
    write_png(o.output, mask_of(matte));
  else
    write_exr(o.output, matte, make_host(common).silent());
  print(o.output + "\n");
  return kDone;
}

}  // namespace

void add_matte(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command =
      add_command(app, common, "matte", "the matte of some things in a frame with Cryptomatte, by any program");
  command("frame", o.frame, "EXR with Cryptomatte: render --layers cryptomatte makes one")->required();
  command("names", o.names, "of the things, as brume info lists them; * stands for anything")->required();
  command("-o,--output", o.output,
          "EXR (R, G, B and A all the matte) or PNG (as it is, 255 is all of a pixel) to write")
      ->required();
  command("--layer", o.layer, "CryptoObject, CryptoMaterial or another, where several have a thing of that name");
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
