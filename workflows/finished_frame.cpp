#include "workflows/finished_frame.h"

#include <fmt/format.h>

#include "render/session/render_state.h"

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

}  // namespace

std::string what_is_unfinished(const std::filesystem::path& path, const Scene& scene, const LayerRequest& layers,
                               const RenderJob& job, const FilterSettings* filter, const Task& task) {
  FrameContent wanted{job.first_sample(), job.end_sample(), job.time_limit > 0 || job.target_error > 0, ""};
  if (filter) wanted.filter = filter->entry().name;
  wanted.parameters = filter ? filter->text() : "";
  const auto differs = [&](const Layers& found) {
    const std::string render = differing_render(found, expected_header(scene, layers, job), "in the file", "now");
    return render.empty() ? wanted.differs(found) : render;
  };
  return what_is_wrong_with(path, differs, /*thorough=*/true, task);
}

std::string what_forbids_resuming(const std::filesystem::path& path, const Scene& scene, const LayerRequest& layers,
                                  const RenderJob& job, const Task& task) {
  const auto differs = [&](const Layers& found) {
    std::string differing = differing_render(found, expected_header(scene, layers, job), "in the file", "now");
    const auto first = static_cast<int>(found.number("sampleFirst").value_or(0));
    const double all = found.number("samplesPerPixel").value_or(0),
                 most = found.number("samplesPerPixelMost").value_or(all);
    if (differing.empty() && (first != job.first_sample() || first + most > job.end_sample()))
      differing = fmt::format("holds the samples {} .. {:.0f}, this render takes {} .. {}", first, first + most - 1,
                              job.first_sample(), job.end_sample() - 1);
    return differing;
  };
  return what_is_wrong_with(path, differs, /*thorough=*/true, task);
}

}  // namespace brume
