#include <fmt/format.h>

#include "app/command.h"
#include "base/error.h"
#include "base/output_file.h"
#include "image/exr_io.h"
#include "render/frame/render_state.h"

namespace brume::app {
namespace {

struct Options {
  std::vector<std::string> parts;
  std::string output;
  bool mergeable = false;
} o;

int run(const Common& common) {
  const std::vector<std::filesystem::path> files(o.parts.begin(), o.parts.end());
  check_writable(o.output, files, ".exr");
  const Task task{common.threads, {}, &interrupted};
  Layers frame = merge_parts(files, o.mergeable, task);
  stamp(frame);
  const int samples = static_cast<int>(frame.number("samplesPerPixel").value_or(0.0));
  const int total = static_cast<int>(frame.number("sampleTotal").value_or(0.0));
  if (samples < total)
    note(fmt::format("{} of {} samples per pixel are there (samples {})", samples, total, frame.text("sampleRanges")));
  write_exr(o.output, frame, task);
  log(common, fmt::format("{} parts, {} samples per pixel", files.size(), samples));
  print(o.output + "\n");
  return kDone;
}

}  // namespace

void add_merge(CLI::App& app, Common& common, Commands& commands) {
  CLI::App* command =
      add_command(app, common, "merge", "merge the parts of a render (render --part i/N) into one frame");
  command->add_option("parts", o.parts, "EXRs written with --part, or finished checkpoints")->required();
  command->add_option("-o,--output", o.output, "EXR to write")->required();
  command->add_flag("--mergeable", o.mergeable, "keep the sums of the samples, so that more parts can be merged later");
  commands[command] = [&common] { return run(common); };
}

}  // namespace brume::app
