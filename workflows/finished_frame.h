#pragma once
#include <filesystem>
#include <string>

#include "base/progress.h"
#include "filters/api/filter.h"
#include "image/finished_frame.h"
#include "render/session/render_job.h"

namespace brume {

/// Whether a file is what a render would write, so that it need not be rendered again.
/// The file is read to its last pixel, and its header says what it is of.
/// @param layers  that are recorded   @param filter  that cleans the frame; null: none does
/// @return empty where it is whole and of this render; else what is wrong with it: "is not there", "is truncated ...",
/// "the seed is 1 in the file, 2 now"
/// @throws Interrupted
std::string what_is_unfinished(const std::filesystem::path& path, const Scene& scene, const LayerRequest& layers,
                               const RenderJob& job, const FilterSettings* filter, const Task& task = {});

/// The same of a checkpoint that a render could go on from.
std::string what_forbids_resuming(const std::filesystem::path& path, const Scene& scene, const LayerRequest& layers,
                                  const RenderJob& job, const Task& task = {});

}  // namespace brume
