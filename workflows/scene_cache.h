#pragma once
#include <cstddef>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <tuple>

#include "render/scene/scene_fingerprint.h"
#include "render/session/renderer.h"
#include "volume/volume_grids.h"

namespace brume {

/// Scenes made ready for rendering, the last few of them kept. A change costs what depends on it: another camera, film,
/// layers or way to trace paths next to nothing; another light or material the structures and the light inside the
/// media; files are read once. For one thread at a time.
class SceneCache {
 public:
  /// What has been computed so far.
  struct Counts {
    size_t read = 0;           ///< grids and meshes, from files
    size_t prepared = 0;       ///< scenes whose structures were built
    size_t lights_solved = 0;  ///< light inside media, for guides
  };

  /// @param most  scenes to keep, as far as they take less than a quarter of the machine's memory beside the last one
  explicit SceneCache(size_t most = 3) : most_(most) {}

  /// A scene ready for rendering; valid until the next call.
  /// @throws InputError: as PreparedScene; Interrupted
  PreparedScene& prepare(Scene scene, const LayerRequest& layers, const Task& task);
  /// Fills in hash and settings; files are read for it once.
  void add_fingerprint(Scene& scene) { brume::add_fingerprint(scene, &hashes_); }

  bool empty() const { return kept_.empty(); }
  /// The one that prepare() gave last.
  PreparedScene& last() const { return *kept_.front().prepared; }
  /// Guides of the last one that are solved and marched fast, for pictures that move.
  const Guides& sketch(const Task& task);
  Counts counts() const;
  /// A density that has been read of a file already.
  void know(const std::filesystem::path& file, std::shared_ptr<const ScalarField> density);
  /// Forgets all but the last scene, and that it may be used again: its files are read anew.
  void forget();

 private:
  struct Kept {
    std::string world;
    std::unique_ptr<PreparedScene> prepared;
    std::unique_ptr<Guides> sketch;
  };
  using GridKey = std::tuple<std::filesystem::path, std::string, std::string>;  // file, what for, name
  void add_grids(VolumeSettings& volume, const Task& task);
  void add_mesh(SurfaceSettings& surface);
  void drop_old();

  const size_t most_;
  std::list<Kept> kept_;  // the last one first
  // As long as a scene uses them.
  std::map<GridKey, std::weak_ptr<const ScalarField>> fields_;
  std::map<GridKey, std::weak_ptr<const VectorField>> colours_;
  std::map<std::filesystem::path, std::weak_ptr<const TriangleMesh>> meshes_;
  FileHashes hashes_;
  Counts counts_;  // of scenes that were dropped, as for lights
};

}  // namespace brume
