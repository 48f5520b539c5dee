#include "workflows/scene_source.h"

#include <algorithm>

#include "render/scene/scene_io.h"
#include "render/scene/scene_outline.h"
#include "render/world/volume_scene.h"
#include "workflows/scene.h"

namespace brume {
namespace {

std::vector<std::string> joined(std::vector<std::string> first, const std::vector<std::string>& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

}  // namespace

SceneSource SceneSource::of_file(const std::filesystem::path& path, std::span<const std::string> assignments,
                                 const Task& task) {
  SceneSource source;
  source.path = path;
  if (is_volume(path)) {
    VolumeScene made = scene_for_volume(path, assignments, task);
    source.text = made.text(path.filename().string());
    source.assumptions = made.all_assumptions();
    source.density = std::move(made.density);
    return source;
  }
  source.text = read_scene_text(path);
  return source;
}

Scene SceneSource::scene(const std::vector<std::string>& more) const {
  return parse_scene(text, path, joined(overrides, more), arrays);
}

Scene SceneSource::scene(const std::vector<std::string>& more, SceneCache& cache) const {
  Scene scene = parse_scene_alone(text, path, joined(overrides, more), arrays);
  cache.add_fingerprint(scene);
  return scene;
}

void SceneSource::check() {
  std::vector<std::string> last;
  for (auto it = overrides.rbegin(); it != overrides.rend(); ++it) {
    const std::string key = it->substr(0, it->find('=') + 1);
    if (std::none_of(last.begin(), last.end(), [&](const std::string& later) { return later.starts_with(key); }))
      last.push_back(*it);
  }
  overrides.assign(last.rbegin(), last.rend());
  parse_scene_alone(text, path, overrides, arrays);
}

std::string SceneSource::as_file() const {
  return edited_scene(text, path, overrides, arrays);
}

}  // namespace brume
