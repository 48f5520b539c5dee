#include "workflows/finished_frame.h"

#include <fmt/format.h>

#include "base/error.h"
#include "image/exr_io.h"
#include "render/frame/render_state.h"

namespace brume {
namespace {

/// A header that a frame of this render has.
Layers expected_header(const Scene& scene, const LayerRequest& layers, const RenderJob& job) {
  const ivec2 film(scene.film.width, scene.film.height);
  Layers expected(job.crop ? job.crop->width() : film.x, job.crop ? job.crop->height() : film.y);
  if (job.crop) {
    expected.origin = ivec2(job.crop->x0, job.crop->y0);
    expected.display = film;
  }
  describe_render(expected, scene, layers, job);
  return expected;
}

/// The message of an error without the file's name, which its reader knows.
std::string without_name(const std::string& message, const std::filesystem::path& path) {
  const std::string name = path.string() + ": ";
  return message.starts_with(name) ? message.substr(name.size()) : message;
}

/// Runs `check` on a file's header, then reads the file to its end.
template <class Check>
std::string examined(const std::filesystem::path& path, const Task& task, const Check& check) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) return "is not there";
  try {
    const std::string wrong = check(read_header(path));
    if (wrong.empty()) check_exr(path, task);
    return wrong;
  } catch (const InputError& error) {
    return without_name(error.what(), path);
  }
}

}  // namespace

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

std::string what_is_unfinished(const std::filesystem::path& path, const Scene& scene, const LayerRequest& layers,
                               const RenderJob& job, const FilterSettings* filter, const Task& task) {
  return examined(path, task, [&](const Layers& found) -> std::string {
    const std::string differing = differing_render(found, expected_header(scene, layers, job), "in the file", "now");
    if (!differing.empty()) return differing;
    if (found.text("interrupted").starts_with("true")) return "was interrupted in the middle of a pass";
    const auto samples = static_cast<int>(found.number("samplesPerPixel").value_or(0));
    const auto first = static_cast<int>(found.number("sampleFirst").value_or(0));
    const bool open_ended = job.time_limit > 0 || job.target_error > 0 || job.next_round;
    if (open_ended ? samples == 0 : first != job.first_sample() || first + samples != job.end_sample())
      return fmt::format("holds the samples {} .. {}, not {} .. {}", first, first + samples - 1, job.first_sample(),
                         job.end_sample() - 1);
    const std::string cleaned = found.text("filter", "none") + " " + found.text("filterParameters");
    const std::string wanted = filter ? filter->entry().name + " " + filter->text() : "none ";
    if (cleaned != wanted) return fmt::format("was cleaned by {}, not {}", cleaned, wanted);
    return "";
  });
}

std::string what_forbids_resuming(const std::filesystem::path& path, const Scene& scene, const LayerRequest& layers,
                                  const RenderJob& job, const Task& task) {
  return examined(path, task, [&](const Layers& found) -> std::string {
    const std::string differing = differing_render(found, expected_header(scene, layers, job), "in the file", "now");
    if (!differing.empty()) return differing;
    const auto first = static_cast<int>(found.number("sampleFirst").value_or(0));
    const double all = found.number("samplesPerPixel").value_or(0),
                 most = found.number("samplesPerPixelMost").value_or(all);
    if (first != job.first_sample() || first + most > job.end_sample())
      return fmt::format("holds the samples {} .. {:.0f}, this render takes {} .. {}", first, first + most - 1,
                         job.first_sample(), job.end_sample() - 1);
    return "";
  });
}

}  // namespace brume
