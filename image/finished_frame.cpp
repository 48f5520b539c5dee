#include "image/finished_frame.h"

#include <fmt/format.h>

#include "base/error.h"
#include "image/exr_io.h"

namespace brume {

Layers read_header(const std::filesystem::path& path) {
  const ExrInfo info = read_exr_info(path);
  Layers frame(info.data.width(), info.data.height());
  frame.header = info.header;
  if (info.data != info.display) {
    frame.origin = info.data.lo;
    frame.display = info.display.hi - info.display.lo;
  }
  return frame;
}

std::string what_is_wrong_with(const std::filesystem::path& path,
                               const std::function<std::string(const Layers& header)>& differs, bool thorough,
                               const Task& task) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) return kNotThere;
  try {
    const std::string wrong = differs(read_header(path));
    if (wrong.empty() && thorough) check_exr(path, task);
    return wrong;
  } catch (const InputError& error) {
    const std::string message = error.what(), name = path.string() + ": ";  // which its reader knows
    return message.starts_with(name) ? message.substr(name.size()) : message;
  }
}

std::string FrameContent::differs(const Layers& header) const {
  if (header.text("interrupted").starts_with("true")) return "was interrupted in the middle of a pass";
  const auto samples = static_cast<int64_t>(header.number("samplesPerPixel").value_or(0));
  const auto begin = static_cast<int64_t>(header.number("sampleFirst").value_or(0));
  if (open_ended ? samples == 0 : begin != first || begin + samples != end)
    return fmt::format("holds the samples {} .. {}, not {} .. {}", begin, begin + samples - 1, first, end - 1);
  const auto described = [&](const std::string& name, const std::string& text) {
    return name.empty() ? std::string("no filter") : parameters ? name + " " + text : name;
  };
  const std::string found = described(header.text("filter"), header.text("filterParameters")),
                    wanted = described(filter, parameters.value_or(""));
  return found == wanted ? "" : fmt::format("was cleaned by {}, not {}", found, wanted);
}

}  // namespace brume
