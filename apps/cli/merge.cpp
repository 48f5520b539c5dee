#include <memory>

#include "apps/cli/command.h"
#include "base/sequence.h"
#include "workflows/merge_frames.h"

namespace brume::app {
namespace {

struct Options {
  std::vector<std::string> parts;
  std::string numbers;
  MergeOptions merge;
};

int run(const Options& o, const Common& common) {
  MergeOptions options = o.merge;
  for (const std::string& part : o.parts) options.parts.push_back(RenderPart::of_file(part));
  if (!o.numbers.empty()) options.numbers = parse_frames(o.numbers);
  merge_frames(options, make_host(common));
  return kDone;
}

}  // namespace

void add_merge(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command =
      add_command(app, common, "merge", "merge the parts of a render (render --part i/N) into one frame");
  command(
      "files", o.parts,
      "EXRs written with --part, or finished checkpoints; a name such as parts/###.exr stands for all that are there")
      ->required();
  command("-o,--output", o.merge.output, "EXR to write")->required();
  command("--mergeable", o.merge.mergeable, "keep the sums of the samples, so that more parts can be merged later");
  command("--parts", o.numbers, "numbers of the parts that must be there: 1-8");
  command("--when-complete", o.merge.when_complete, "write nothing, and be content, while some are not there");
  command("--resume", o.merge.resume, "leave out what is merged already: the output is whole and of this render");
  command("--discard", o.merge.discard, "remove the parts once the output has been read back whole");
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
