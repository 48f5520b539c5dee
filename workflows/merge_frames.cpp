#include "workflows/merge_frames.h"

#include <fmt/format.h>

#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "image/exr_io.h"
#include "workflows/finished_frame.h"
#include "workflows/version.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

/// What is to be merged, and what of it is missing.
struct Parts {
  std::vector<RenderPart> all;
  std::vector<fs::path> files;
  std::vector<int> missing;  // numbers of files that are not there
};

Parts find_parts(const MergeOptions& o) {
  Parts parts;
  const auto add_file = [&](const fs::path& file) {
    parts.files.push_back(file);
    parts.all.push_back(RenderPart::of_file(file));
  };
  for (const RenderPart& part : o.parts) {
    if (part.frame) {
      parts.all.push_back(part);
      continue;
    }
    const std::optional<FramePattern> pattern = FramePattern::of(part.file);
    if (!pattern && !o.numbers.empty())
      throw InputError(
          fmt::format("{}: --parts needs a name with a place for the part's number, such as ###.exr", part.name));
    if (!pattern) {
      add_file(part.file);
      continue;
    }
    for (const int number : o.numbers.empty() ? pattern->frames_on_disk() : o.numbers) {
      add_file(pattern->path(number));
      std::error_code ignored;
      if (!fs::exists(parts.files.back(), ignored)) parts.missing.push_back(number);
    }
    if (parts.files.empty()) throw InputError(fmt::format("{}: no file of that name is there", part.name));
  }
  if (parts.all.empty()) throw InputError("no parts: expected at least one");
  return parts;
}

/// Whether the output is whole already, and of the render that the parts are of, as far as these are there.
bool is_merged(const MergeOptions& o, const Parts& parts, const Host& host) {
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
    if (wrong.empty()) check_exr(o.output, host.silent());
  } catch (const InputError& error) {
    wrong = error.what();
  }
  if (!wrong.empty()) host.message(fmt::format("{} is merged again: {}", o.output.string(), wrong));
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

}  // namespace

std::optional<Layers> merge_frames(const MergeOptions& o, const Host& host) {
  const Parts parts = find_parts(o);
  const bool writes = !o.output.empty();
  if (writes) check_writable(o.output, parts.files, ".exr");
  if (o.resume && is_merged(o, parts, host)) {
    host.log(o.output.string() + " is merged already");
    if (o.discard) discard(parts);
    return std::nullopt;
  }
  if (!parts.missing.empty()) {
    const std::string text = fmt::format("{} of {} parts are not there: {} ({})", parts.missing.size(),
                                         parts.all.size(), frames_text(parts.missing), o.parts[0].name);
    if (!o.when_complete) throw InputError(text);
    host.log("not merged yet: " + text);
    return std::nullopt;
  }
  Layers frame = merge_parts(parts.all, o.mergeable, host.silent());
  stamp(frame);
  const int samples = static_cast<int>(frame.number("samplesPerPixel").value_or(0.0));
  const int total = static_cast<int>(frame.number("sampleTotal").value_or(0.0));
  if (samples < total)
    host.note(
        fmt::format("{} of {} samples per pixel are there (samples {})", samples, total, frame.text("sampleRanges")));
  if (writes) {
    write_exr(o.output, frame, host.silent());
    if (o.discard) {
      check_exr(o.output, host.silent());
      discard(parts);
    }
  }
  host.log(fmt::format("{} parts, {} samples per pixel", parts.all.size(), samples));
  if (writes && host.wrote) host.wrote(o.output);
  return frame;
}

}  // namespace brume
