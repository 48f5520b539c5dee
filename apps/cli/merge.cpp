#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "apps/cli/command.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "image/exr_io.h"
#include "render/session/render_state.h"
#include "workflows/finished_frame.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<std::string> parts;
  std::string output, numbers;
  bool mergeable = false, resume = false, when_complete = false, discard = false;
};

/// The files to merge, and those among them that are missing.
struct Parts {
  std::vector<fs::path> files;
  std::vector<int> missing;  // their numbers
};

Parts find_parts(const Options& o) {
  Parts parts;
  for (const std::string& name : o.parts) {
    const std::optional<FramePattern> pattern = FramePattern::of(name);
    if (!pattern && !o.numbers.empty())
      throw InputError(
          fmt::format("{}: --parts needs a name with a place for the part's number, such as ###.exr", name));
    if (!pattern) {
      parts.files.emplace_back(name);
      continue;
    }
    for (const int number : o.numbers.empty() ? pattern->frames_on_disk() : parse_frames(o.numbers)) {
      parts.files.push_back(pattern->path(number));
      std::error_code ignored;
      if (!fs::exists(parts.files.back(), ignored)) parts.missing.push_back(number);
    }
    if (parts.files.empty()) throw InputError(fmt::format("{}: no file of that name is there", name));
  }
  return parts;
}

/// Whether the output is whole already, and of the render that the parts are of, as far as these are there.
bool is_merged(const Options& o, const Parts& parts, const Task& task) {
  std::error_code ignored;
  if (!fs::exists(o.output, ignored)) return false;
  std::string wrong;
  try {
    const Layers merged = read_header(o.output);
    if (!o.mergeable && merged.number("samplesPerPixel") != merged.number("sampleTotal"))
      wrong = "holds a part of its samples only";
    for (const fs::path& file : parts.files)
      if (wrong.empty() && fs::exists(file, ignored))
        wrong = differing_render(merged, read_header(file), "in it", "in the parts");
    if (wrong.empty()) check_exr(o.output, task);
  } catch (const InputError& error) {
    wrong = error.what();
  }
  if (!wrong.empty()) warn(fmt::format("{} is merged again: {}", o.output, wrong));
  return wrong.empty();
}

/// Removes the parts, and their folder where nothing else is in it.
void discard(const Parts& parts) {
  std::error_code ignored;
  for (const fs::path& file : parts.files) fs::remove(file, ignored);
  for (const fs::path& file : parts.files)
    if (!file.parent_path().empty() && !fs::equivalent(file.parent_path(), fs::current_path(), ignored))
      fs::remove(file.parent_path(), ignored);
}

int run(const Options& o, const Common& common) {
  const Task task{common.threads, {}, &interrupted};
  const Parts parts = find_parts(o);
  check_writable(o.output, parts.files, ".exr");
  if (o.resume && is_merged(o, parts, task)) {
    log(common, o.output + " is merged already");
    if (o.discard) discard(parts);
    return kDone;
  }
  if (!parts.missing.empty()) {
    const std::string text = fmt::format("{} of {} parts are not there: {} ({})", parts.missing.size(),
                                         parts.files.size(), frames_text(parts.missing), o.parts[0]);
    if (!o.when_complete) throw InputError(text);
    log(common, "not merged yet: " + text);
    return kDone;
  }
  Layers frame = merge_parts(parts.files, o.mergeable, task);
  stamp(frame);
  const int samples = static_cast<int>(frame.number("samplesPerPixel").value_or(0.0));
  const int total = static_cast<int>(frame.number("sampleTotal").value_or(0.0));
  if (samples < total)
    note(fmt::format("{} of {} samples per pixel are there (samples {})", samples, total, frame.text("sampleRanges")));
  write_exr(o.output, frame, task);
  if (o.discard) {
    check_exr(o.output, task);
    discard(parts);
  }
  log(common, fmt::format("{} parts, {} samples per pixel", parts.files.size(), samples));
  print(o.output + "\n");
  return kDone;
}

}  // namespace

void add_merge(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  CLI::App* command =
      add_command(app, common, "merge", "merge the parts of a render (render --part i/N) into one frame");
  command
      ->add_option(
          "parts", o.parts,
          "EXRs written with --part, or finished checkpoints; a name such as parts/###.exr stands for all that are there")
      ->required();
  command->add_option("-o,--output", o.output, "EXR to write")->required();
  command->add_flag("--mergeable", o.mergeable, "keep the sums of the samples, so that more parts can be merged later");
  command->add_option("--parts", o.numbers, "numbers of the parts that must be there: 1-8");
  command->add_flag("--when-complete", o.when_complete, "write nothing, and be content, while some are not there");
  command->add_flag("--resume", o.resume, "leave out what is merged already: the output is whole and of this render");
  command->add_flag("--discard", o.discard, "remove the parts once the output has been read back whole");
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
