// What Python gives for a scene, brought into the forms that the workflows know.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "apps/python/scene.h"
#include "base/text.h"
#include "render/files/mesh.h"
#include "render/files/polygon.h"
#include "render/scene/instance_files.h"
#include "volume/placement.h"

namespace brume::python {
namespace {

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

const std::vector<std::string> kScalarGrids = {"density", "temperature", "flame"}, kVectorGrids = {"color", "velocity"},
                               kMeshArrays = {"vertices", "faces", "normals", "texcoords"},
                               kInstanceArrays = {"matrices", "densities", "tints", "time_offsets"},
                               kLists = {"instances", "lights", "surfaces", "volumes"};

bool is_one_of(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Of nested lists too; 0 for what is no array.
py::ssize_t dimensions(py::handle value) {
  if (PyUnicode_Check(value.ptr()) || PyBytes_Check(value.ptr())) return 0;
  try {
    return py::module_::import("numpy").attr("ndim")(value).cast<py::ssize_t>();
  } catch (py::error_already_set& error) {  // rows of different lengths
    let_through(error);
    return 0;
  }
}

/// An array that no key of a scene holds. @param table  as errors call it: "volumes.0"
void refuse_array(const std::string& table, const std::string& key, py::handle value) {
  if (dimensions(value) < 3) return;
  std::vector<std::string> names = kScalarGrids;
  names.insert(names.end(), kVectorGrids.begin(), kVectorGrids.end());
  throw InputError(fmt::format("{}: no array '{}'{}", table, key, suggestion(key, names)));
}

/// @param shape  that is expected, in words
[[noreturn]] void refuse_shape(const std::string& what, const std::string& shape, const py::array& array) {
  throw InputError(fmt::format("{}: expected {}, found {}", what, shape, shape_of(array)));
}

VoxelArray voxels(const py::array& array, py::ssize_t offset) {
  VoxelArray view;
  view.data = static_cast<const std::byte*>(array.data()) + offset;
  view.type = array.itemsize() == 8 ? VoxelArray::Type::kDouble : VoxelArray::Type::kFloat;
  for (int a = 0; a < 3; ++a) {
    view.size[a] = static_cast<int>(array.shape(a));
    view.stride[static_cast<size_t>(a)] = array.strides(a);
  }
  return view;
}

/// An array of floats or doubles that can be read where it lies; a copy of any other.
py::array readable(const std::string& what, py::handle value) {
  py::array array = to_real_array(what, value);
  const py::object kind = array.dtype().attr("char");
  const std::string code = to_text(kind);
  const bool aligned = (array.flags() & py::detail::npy_api::NPY_ARRAY_ALIGNED_) != 0;
  if ((code == "f" || code == "d") && aligned && array.dtype().attr("isnative").cast<bool>()) return array;
  return array.attr("astype")(code == "d" ? "float64" : "float32");
}

/// Rows of so many numbers.
template <class Row>
std::vector<Row> rows(const std::string& what, py::handle value, const char* expected) {
  const Doubles array(to_real_array(what, value));
  constexpr int kColumns = Row::length();
  if (array.ndim() != 2 || array.shape(1) != kColumns) refuse_shape(what, expected, array);
  std::vector<Row> result(static_cast<size_t>(array.shape(0)));
  const double* from = array.data();
  for (Row& row : result)
    for (int a = 0; a < kColumns; ++a) row[a] = static_cast<typename Row::value_type>(*from++);
  return result;
}

/// Matrices of four rows, as a scene's text has them.
std::vector<dmat4> matrices(const std::string& what, py::handle value) {
  const Doubles array(to_real_array(what, value));
  if (array.ndim() != 3 || array.shape(1) != 4 || array.shape(2) != 4) refuse_shape(what, "instances x 4 x 4", array);
  std::vector<dmat4> result(static_cast<size_t>(array.shape(0)));
  const double* from = array.data();
  for (size_t i = 0; i < result.size(); ++i) {
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 4; ++column) result[i][column][row] = *from++;
    if (const std::string wrong = what_forbids_transform(result[i]); !wrong.empty())
      throw InputError(fmt::format("{}: matrix {} is {}; expected an invertible affine map", what, i, wrong));
  }
  return result;
}

std::vector<double> numbers(const std::string& what, py::handle value) {
  const Doubles array(to_real_array(what, value));
  if (array.ndim() != 1) refuse_shape(what, "instances", array);
  return {array.data(), array.data() + array.size()};
}

/// Faces of three corners or more, cut into triangles.
Polygons polygons(const std::string& what, py::handle value) {
  const py::array given = to_real_array(what, value);
  if (given.size() == 0) return {};  // NumPy makes an array of floats of [], so its type says nothing
  if (std::string_view("iu").find(given.dtype().kind()) == std::string_view::npos)
    throw py::type_error(
        fmt::format("{}: expected integers, found {}", what, to_text(py::str(given.dtype().attr("name")))));
  const py::array_t<int64_t, py::array::c_style | py::array::forcecast> array(given);
  if (array.ndim() != 2 || array.shape(1) < 3) refuse_shape(what, "faces x corners, at least 3 of them", array);
  Polygons result;
  result.sides = static_cast<size_t>(array.shape(1));
  for (py::ssize_t i = 0; i < array.size(); ++i)
    result.corners.push_back(
        static_cast<int>(std::clamp<int64_t>(array.data()[i], -1, std::numeric_limits<int>::max())));
  return result;
}

/// Cuts polygons into triangles (render/files/polygon.h). Those of vertices that are not there become fans, which
/// place_mesh refuses.
void cut_into_triangles(const Polygons& polygons, const std::string& name, TriangleMesh& mesh) {
  mesh.triangles.clear();
  mesh.notes.clear();
  const auto count = static_cast<int>(mesh.positions.size());
  size_t crossing = 0, not_finite = 0;
  std::vector<dvec3> outline;
  for (size_t first = 0; first < polygons.corners.size(); first += polygons.sides) {
    const std::span<const int> corners(polygons.corners.data() + first, polygons.sides);
    PolygonTriangles cut;
    const bool there = std::all_of(corners.begin(), corners.end(), [&](int c) { return c >= 0 && c < count; });
    if (there) {
      outline.clear();
      for (const int c : corners) outline.push_back(mesh.positions[static_cast<size_t>(c)]);
      if (!std::all_of(outline.begin(), outline.end(),
                       [](const dvec3& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); })) {
        ++not_finite;
        continue;
      }
      cut = triangulate(outline);
    } else {
      for (int k = 2; k < static_cast<int>(corners.size()); ++k) cut.triangles.emplace_back(0, k - 1, k);
    }
    crossing += cut.crosses_itself;
    for (const ivec3& t : cut.triangles)
      mesh.triangles.emplace_back(corners[static_cast<size_t>(t.x)], corners[static_cast<size_t>(t.y)],
                                  corners[static_cast<size_t>(t.z)]);
  }
  if (not_finite)
    mesh.notes.push_back(
        fmt::format("{}: {} faces with coordinates that are not finite were left out", name, not_finite));
  if (crossing)
    mesh.notes.push_back(fmt::format("{}: {} polygons cross themselves: their triangles overlap or leave something out",
                                     name, crossing));
}

/// Refuses grids of other sizes than those beside them.
class OneSize {
 public:
  explicit OneSize(std::string volume) : volume_(std::move(volume)) {}
  void check(const std::string& name, const ivec3& size) {
    if (!first_.empty() && size != size_)
      throw InputError(fmt::format("{}.{}: {} x {} x {} voxels, its {} has {} x {} x {}", volume_, name, size.x, size.y,
                                   size.z, first_, size_.x, size_.y, size_.z));
    if (first_.empty()) first_ = name;
    size_ = size;
  }

 private:
  const std::string volume_;
  std::string first_;
  ivec3 size_{0};
};

void check_sizes(const std::string& volume, const VolumeArrays& arrays, const VolumeGrids* others) {
  OneSize size(volume);
  const auto scalar = [&](const char* name, const std::optional<VoxelArray>& array, bool kept) {
    if (array)
      size.check(name, array->size);
    else if (kept)
      size.check(name, others->size);
  };
  const auto vectors = [&](const char* name, const auto& parts, bool kept) {
    scalar(name, parts ? std::optional((*parts)[0]) : std::nullopt, kept);
  };
  scalar("density", arrays.density, others && others->density);
  scalar("temperature", arrays.temperature, others && others->temperature);
  scalar("flame", arrays.flame, others && others->flame);
  vectors("color", arrays.colour, others && others->colour);
  vectors("velocity", arrays.velocity, others && others->velocity);
}

/// The text of a scene out of a dict, key by key.
class SceneWriter {
 public:
  explicit SceneWriter(SceneChanges& arrays) : arrays_(arrays) {}

  std::string write(const py::dict& scene) {
    std::string text;
    for (const auto& [key, value] : scene) {  // what stands alone comes before the tables
      const std::string name = to_text(key);
      if (is_table(value) || is_list(name, value) || value.is_none()) continue;
      if (has_tables(value)) throw InputError(fmt::format("{}: no list of dicts{}", name, suggestion(name, kLists)));
      text += fmt::format("{} = {}\n", to_toml_key(name), to_toml_value(value));
    }
    for (const auto& [key, value] : scene) {
      const std::string name = to_text(key);
      if (is_one_of(kLists, name) && is_table(value))
        throw InputError(fmt::format("{}: expected a list of dicts, found a {}", name, type_name(value)));
      if (is_table(value)) {
        text += fmt::format("[{}]\n", to_toml_key(name)) + table(name, value);
      } else if (is_list(name, value)) {
        size_t index = 0;
        for (const py::handle entry : value) {
          if (!is_table(entry))
            throw InputError(fmt::format("{}.{}: expected a dict, found {}", name, index, type_name(entry)));
          text += fmt::format("[[{}]]\n", to_toml_key(name)) + table(name, entry, index);
          ++index;
        }
      }
    }
    return text;
  }

 private:
  static bool is_table(py::handle value) { return PyMapping_Check(value.ptr()) && py::hasattr(value, "items"); }
  static bool is_list(const std::string& name, py::handle value) {
    return is_one_of(kLists, name) && py::isinstance<py::sequence>(value) && !PyUnicode_Check(value.ptr());
  }
  static bool has_tables(py::handle value) {
    if (!PyList_Check(value.ptr()) && !PyTuple_Check(value.ptr())) return false;
    return std::any_of(value.begin(), value.end(), &is_table);
  }
  std::string table(const std::string& name, py::handle entries, std::optional<size_t> index = {}) {
    std::string text;
    for (const auto& [key, value] : py::dict(py::reinterpret_borrow<py::object>(entries))) {
      const std::string word = to_text(key);
      if (value.is_none() || (index && arrays_.take_array(name, *index, word, value))) continue;
      refuse_array(index ? fmt::format("{}.{}", name, *index) : name, word, value);
      text += fmt::format("{} = {}\n", to_toml_key(word), to_toml_value(value));
    }
    return text;
  }

  SceneChanges& arrays_;
};

}  // namespace

SceneChanges::SceneChanges(const py::kwargs& keywords) {
  for (const auto& [key, value] : keywords) {
    if (value.is_none()) continue;
    const std::string name = to_key(key);
    const std::vector<std::string> words = split(name, '.');
    char* end = nullptr;
    const size_t index = words.size() == 3 ? std::strtoul(words[1].c_str(), &end, 10) : 0;
    if (end && !*end && !words[1].empty() && take_array(words[0], index, words[2], value)) continue;
    refuse_array(name.substr(0, name.rfind('.')), words.back(), value);
    overrides_.push_back(name + "=" + to_toml(value));
  }
}

bool SceneChanges::take_array(const std::string& list, size_t index, const std::string& key, py::handle value) {
  const std::string what = fmt::format("{}.{}.{}", list, index, key);
  if (list == "volumes" && (is_one_of(kScalarGrids, key) || is_one_of(kVectorGrids, key))) {
    // A number as density, and three as color, are keys of a scene file.
    if (const py::ssize_t n = dimensions(value); (key == "density" && n == 0) || (key == "color" && n < 2))
      return false;
    const bool vectors = is_one_of(kVectorGrids, key);
    const py::array array = readable(what, value);
    if (array.ndim() != (vectors ? 4 : 3) || (vectors && array.shape(3) != 3))
      refuse_shape(what, vectors ? "x, y, z, 3" : "x, y, z", array);
    if (array.size() == 0) refuse_shape(what, "voxels", array);
    alive_.push_back(array);
    VolumeArrays& volume = volumes_[index];
    if (vectors) {
      std::array<VoxelArray, 3> parts;
      for (size_t c = 0; c < 3; ++c) parts[c] = voxels(array, static_cast<py::ssize_t>(c) * array.strides(3));
      (key == "color" ? volume.colour : volume.velocity) = parts;
    } else {
      (key == "density" ? volume.density : key == "flame" ? volume.flame : volume.temperature) = voxels(array, 0);
    }
    return true;
  }
  if (list == "instances" && is_one_of(kInstanceArrays, key)) {
    Places& places = instances_[index];
    if (key == "matrices") places.matrices = matrices(what, value);
    if (key == "tints") places.tints = rows<dvec3>(what, value, "instances x 3");
    if (key == "densities") places.densities = numbers(what, value);
    if (key == "time_offsets") places.time_offsets = numbers(what, value);
    return true;
  }
  if (list != "surfaces" || !is_one_of(kMeshArrays, key)) return false;
  if (key == "normals" && PyUnicode_Check(value.ptr())) return false;  // smooth or flat
  Mesh& mesh = meshes_[index];
  if (key == "vertices") mesh.vertices = rows<dvec3>(what, value, "vertices x 3");
  if (key == "faces") mesh.faces = polygons(what, value);
  if (key == "normals") mesh.normals = rows<vec3>(what, value, "vertices x 3");
  if (key == "texcoords") mesh.texcoords = rows<vec2>(what, value, "vertices x 2");
  return true;
}

void SceneChanges::apply(SceneSource& source, const Task& task) const {
  source.overrides.insert(source.overrides.end(), overrides_.begin(), overrides_.end());
  apply_arrays(source, task);
}

void SceneChanges::apply_arrays(SceneSource& source, const Task& task) const {
  for (const auto& [index, arrays] : volumes_) {
    const auto known = source.arrays.volumes.find(index);
    const VolumeGrids* const others = known == source.arrays.volumes.end() ? nullptr : known->second.get();
    check_sizes(fmt::format("volumes.{}", index), arrays, others);
    source.arrays.volumes[index] = grids_of_arrays(arrays, others, task);
  }
  for (const auto& [index, given] : instances_) {
    const auto known = source.arrays.instances.find(index);
    InstanceList list = known == source.arrays.instances.end() ? InstanceList() : *known->second.list;
    if (given.matrices) list = {*given.matrices, {}, {}, {}};
    if (given.densities) list.densities = *given.densities;
    if (given.tints) list.tints = *given.tints;
    if (given.time_offsets) list.time_offsets = *given.time_offsets;
    std::string content = check_places(fmt::format("instances.{}", index), list);
    source.arrays.instances[index] = {std::make_shared<const InstanceList>(std::move(list)), std::move(content)};
  }
  for (const auto& [index, given] : meshes_) {
    const auto known = source.arrays.meshes.find(index);
    TriangleMesh mesh = known == source.arrays.meshes.end() ? TriangleMesh() : *known->second.mesh;
    const std::string name = fmt::format("surfaces.{}", index);
    if (given.vertices) {
      mesh.positions = *given.vertices;
      mesh.normals.clear();  // of the vertices as they were
    }
    if (given.faces) cut_into_triangles(*given.faces, name, mesh);
    if (given.normals) mesh.normals = *given.normals;
    if (given.texcoords) mesh.texcoords = *given.texcoords;
    if (mesh.positions.empty() || (given.faces ? given.faces->corners.empty() : mesh.triangles.empty()))
      throw InputError(fmt::format("{}: has no {}; a mesh of arrays has vertices and faces", name,
                                   mesh.positions.empty() ? "vertices" : "faces"));
    for (const auto& [what, count] : {std::pair("normals", mesh.normals.size()), {"texcoords", mesh.texcoords.size()}})
      if (count > 0 && count != mesh.positions.size())
        throw InputError(
            fmt::format("{}.{}: {} rows, expected {}, one for each vertex", name, what, count, mesh.positions.size()));
    std::string content = content_of(mesh);
    source.arrays.meshes[index] = {std::make_shared<const TriangleMesh>(std::move(mesh)), std::move(content)};
  }
}

SceneArgument::SceneArgument(py::handle scene) {
  if (py::isinstance<SceneObject>(scene)) {
    object_ = scene.cast<ScenePointer>();
  } else if (PyMapping_Check(scene.ptr()) && py::hasattr(scene, "items") && !PyUnicode_Check(scene.ptr())) {
    text_ = SceneWriter(arrays_).write(py::dict(py::reinterpret_borrow<py::object>(scene)));
    if (text_.empty()) text_ = "\n";
  } else if (PyUnicode_Check(scene.ptr()) && to_text(scene).find('\n') != std::string::npos) {
    text_ = to_text(scene);
  } else {
    file_ = to_path(scene);
  }
}

SceneSource SceneArgument::source(const std::vector<std::string>& assignments, const Task& task) const {
  if (object_) return object_->source();
  if (file_) return SceneSource::of_file(*file_, assignments, task);
  SceneSource source;
  source.path = "scene.toml";
  source.text = text_;
  arrays_.apply(source, task);
  return source;
}

}  // namespace brume::python
