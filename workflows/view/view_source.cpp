#include "workflows/view/view_source.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "render/scene/scene_io.h"
#include "workflows/scene.h"
#include "workflows/view/frame_viewer.h"
#include "workflows/view/viewer.h"

namespace brume {

bool is_frame_file(const std::filesystem::path& path) {
  const std::string ending = lower(path.extension().string());
  return ending == ".exr" || ending == ".hdr" || ending == ".pfm";
}

void check_viewable(const ViewOptions& options) {
  std::error_code ignored;
  const auto there = std::find_if(options.frames.begin(), options.frames.end(), [&](int number) {
    return std::filesystem::exists(file_of_frame(options.scene, number), ignored);
  });
  const bool found = there != options.frames.end();
  const std::filesystem::path file = found ? file_of_frame(options.scene, *there) : options.scene;
  check_exists(file);
  if (is_frame_file(options.scene)) {
    if (!options.overrides.empty())
      throw InputError(fmt::format("-D {}: {} is a frame, which has no keys to set; expected the scene that it is of",
                                   options.overrides[0], file.string()));
    const ViewedFrame checked(file, options.map);
    return;
  }
  if (!options.map.empty())
    throw InputError(fmt::format("--map {}: says what the layers of another renderer's frame are; {} is no frame",
                                 options.map.string(), file.string()));
  if (is_volume(file)) return;
  std::vector<std::string> overrides = options.overrides;
  if (found) overrides.push_back(fmt::format("render.frame={}", *there));
  read_scene_alone(file, overrides);
}

std::unique_ptr<ViewSource> make_view_source(const ViewOptions& options, const Host& host, ViewListener& listener) {
  if (is_frame_file(options.scene)) return std::make_unique<FrameViewer>(options, host, listener);
  return std::make_unique<Viewer>(options, host, listener);
}

}  // namespace brume
