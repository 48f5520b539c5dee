#pragma once
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "render/scene/scene.h"
#include "workflows/host.h"
#include "workflows/scene_cache.h"

namespace brume {

/// What a scene is made from, read once: a text, assignments on it, and what stands in no file.
struct SceneSource {
  std::filesystem::path path;  ///< of the scene file or volume; relative paths in the text start at its folder
  std::string text;
  SceneArrays arrays;
  std::vector<std::string> overrides;          ///< "camera.fov=30", the later ones having the last word
  std::vector<std::string> assumptions;        ///< about a bare volume, a line each
  std::shared_ptr<const ScalarField> density;  ///< of a bare volume, as it was read

  /// A scene file's, or what is made up around an OpenVDB file.
  /// @param assignments  that follow, for what is made up to go with   @throws InputError
  static SceneSource of_file(const std::filesystem::path& path, std::span<const std::string> assignments = {},
                             const Task& task = {});

  /// @param more  assignments after its own   @throws InputError: as parse_scene
  Scene scene(const std::vector<std::string>& more = {}) const;
  /// The same, its files read for its fingerprint once.
  Scene scene(const std::vector<std::string>& more, SceneCache& cache) const;
  /// Makes later assignments of a key the only ones. @throws InputError for what is no scene; files are not read
  void check();
  /// The scene as a file of its own, but for arrays, with absolute names of files.
  std::string as_file() const;
};

}  // namespace brume
