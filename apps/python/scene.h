#pragma once
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "volume/array_volume.h"
#include "workflows/scene_source.h"

namespace brume::python {

/// brume.Scene: what it is made from, and what has been prepared of it.
class SceneObject {
 public:
  explicit SceneObject(SceneSource source);

  SceneSource source() const;
  /// Lets `edit` make another source of it, one at a time; where it throws, it stays.
  void change(const std::function<void(SceneSource&)>& edit);
  /// What had been computed when the last piece of work ended.
  SceneCache::Counts counts() const;

 private:
  friend class SceneUse;
  mutable std::mutex mutex_;  // of source and counts
  std::mutex changing_;
  SceneSource source_;
  SceneCache::Counts counts_;
  std::timed_mutex busy_;  // of cache and told
  SceneCache cache_;
  std::set<std::string> told_;
};
using ScenePointer = std::shared_ptr<SceneObject>;

/// A scene while a piece of work has it for itself.
class SceneUse {
 public:
  /// Waits until it is free. @throws Interrupted
  SceneUse(SceneObject& scene, const Task& task);
  ~SceneUse();
  SceneUse(SceneUse&&) = delete;

  SceneCache& cache() { return scene_.cache_; }
  /// A host that says each note of the scene once.
  Host host(const Work& work);

 private:
  SceneObject& scene_;
  std::unique_lock<std::timed_mutex> lock_;
};

/// The faces of a mesh, as rows of an array.
struct Polygons {
  std::vector<int> corners;  ///< vertices, face by face
  size_t sides = 3;          ///< of each
};

/// Keywords and arrays of Python on their way into a scene: looked at with Python's lock, built without.
class SceneChanges {
 public:
  /// camera__fov=30, volumes__0__density=array: an array where it stands for a grid or a part of a mesh.
  /// None leaves a key as it is. @throws InputError; py::type_error for arrays of other things than real numbers
  explicit SceneChanges(const py::kwargs& keywords);
  SceneChanges() = default;

  /// @return whether a key of [[volumes]], [[instances]] or [[surfaces]] is one for an array, and has one
  bool take_array(const std::string& list, size_t index, const std::string& key, py::handle value);
  bool has_arrays() const { return !volumes_.empty() || !instances_.empty() || !meshes_.empty(); }
  /// Assignments on the scene's text.
  const std::vector<std::string>& overrides() const { return overrides_; }
  /// Gives a scene the arrays and the assignments. Without Python's lock. @throws InputError
  void apply(SceneSource& source, const Task& task) const;
  /// The arrays alone.
  void apply_arrays(SceneSource& source, const Task& task) const;

 private:
  struct Mesh {
    std::optional<std::vector<dvec3>> vertices;
    std::optional<Polygons> faces;
    std::optional<std::vector<vec3>> normals;
    std::optional<std::vector<vec2>> texcoords;
  };
  struct Places {
    std::optional<std::vector<dmat4>> matrices;
    std::optional<std::vector<double>> densities;
    std::optional<std::vector<dvec3>> tints;
    std::optional<std::vector<double>> time_offsets;
  };
  std::vector<std::string> overrides_;
  std::map<size_t, VolumeArrays> volumes_;
  std::map<size_t, Places> instances_;
  std::map<size_t, Mesh> meshes_;
  std::vector<py::array> alive_;  // what the volumes look into
};

/// What a caller means by a scene: a path, a text, a dict or a brume.Scene.
class SceneArgument {
 public:
  /// @throws InputError, py::type_error
  explicit SceneArgument(py::handle scene);

  /// The scene, where it is one already.
  const ScenePointer& object() const { return object_; }
  /// The file, where it is one.
  const std::optional<std::string>& file() const { return file_; }
  /// Reads it. Without Python's lock.
  /// @param assignments  that follow: what is made up around a bare volume goes with them   @throws InputError
  SceneSource source(const std::vector<std::string>& assignments, const Task& task) const;

 private:
  ScenePointer object_;
  std::optional<std::string> file_;
  std::string text_;
  SceneChanges arrays_;
};

}  // namespace brume::python
