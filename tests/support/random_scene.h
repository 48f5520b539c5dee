#pragma once
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>

#include "render/scene/scene.h"

namespace brume::test {

/// A small scene drawn from a seed: a few media of every kind, apart, behind, inside or overlapping one another;
/// lights of every kind, outside and inside; meshes of every material; a camera outside or inside; lens and motion.
/// Radiance is about 1, optical depths are between 0.3 and 12, and no light has a mean that a few hundred samples per
/// pixel cannot find.
struct RandomScene {
  uint64_t seed = 0;
  std::string toml;             ///< as `brume render` reads it from the folder of its files
  std::set<std::string> kinds;  ///< what it holds: "grid", "inside", "sun", "floor", "glass", "lens", ...
  Scene scene;                  ///< the same, read

  /// The kinds in one line.
  std::string text() const;
};

/// Writes the scene, "seed.toml", and its volumes, meshes and pictures into a folder. The same for the same seed, on
/// every machine.
/// @param most_media  there are one to so many
RandomScene random_scene(uint64_t seed, const std::filesystem::path& folder, int most_media = 3);

}  // namespace brume::test
