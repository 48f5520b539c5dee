#include "apps/python/scene.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <chrono>

#include "apps/python/bindings.h"
#include "apps/python/render.h"
#include "base/text.h"
#include "help_scene_txt.h"
#include "render/files/mesh.h"
#include "workflows/render_frame.h"

namespace brume::python {
namespace {

constexpr const char* kExplainHelp =
    "What a render would model, and what it costs, in lines; as `brume render --explain`.\n\n"
    "spp, layers, clean, statistics: as render takes them. Keywords set keys for this call alone. Raises InputError.";

constexpr const char* kCountsHelp =
    "What has been computed so far: files read, scenes prepared (structures built for what paths can meet), times that\n"
    "light was solved (inside media, for guides).";

ScenePointer make_scene(const py::object& scene, const py::kwargs& keywords) {
  const SceneArgument argument(scene);
  const SceneChanges changes(keywords);
  ScenePointer object;
  run_work({}, 0, [&](const Work& work) {
    SceneSource source = argument.source(changes.overrides(), work.task);
    source.path = std::filesystem::absolute(source.path);
    changes.apply(source, work.task);
    source.check();
    for (const std::string& line : source.assumptions) work.log("assumed " + line);
    object = std::make_shared<SceneObject>(std::move(source));
  });
  return object;
}

void set(const ScenePointer& scene, const py::kwargs& keywords) {
  const SceneChanges changes(keywords);
  run_work({}, 0, [&](const Work& work) {
    scene->change([&](SceneSource& source) {
      changes.apply(source, work.task);
      source.check();
    });
  });
}

ScenePointer copy_of(const SceneObject& scene) {
  return std::make_shared<SceneObject>(scene.source());
}

std::string explain(const ScenePointer& scene, const py::object& spp, const py::object& layers, bool statistics,
                    const py::object& clean, const py::kwargs& keywords) {
  RenderOptions options;
  set_layers(options, layers, statistics, /*buckets=*/false, clean);
  set_spp(options, spp);
  const SceneChanges changes(keywords);
  std::string text;
  run_work({}, 0, [&](const Work& work) {
    SceneUse use(*scene, work.task);
    SceneSource source = scene->source();
    changes.apply(source, work.task);
    set_source(options, source);
    options.scenes = &use.cache();
    text = explain_render(options, use.host(work));
  });
  return text;
}

// ---- as a dict

py::array_t<float> array_of(const BrickGrid& grid, const ivec3& size) {
  py::array_t<float> array({size.x, size.y, size.z});
  copy_values(grid, size, array.mutable_data());
  return array;
}

py::array_t<float> array_of(const VectorField& field, const ivec3& size) {
  py::array_t<float> array({size.x, size.y, size.z, 3});
  for (size_t c = 0; c < 3; ++c) copy_values(field.bricks.parts[c], size, array.mutable_data() + c, 3);
  return array;
}

template <class Value, class Row>
py::array_t<Value> array_of(const std::vector<Row>& rows) {
  constexpr int kColumns = Row::length();
  py::array_t<Value> array({static_cast<py::ssize_t>(rows.size()), static_cast<py::ssize_t>(kColumns)});
  Value* to = array.mutable_data();
  for (const Row& row : rows)
    for (int a = 0; a < kColumns; ++a) *to++ = row[a];
  return array;
}

py::dict arrays_of(const VolumeGrids& grids) {
  py::dict arrays;
  const auto add = [&](const char* name, const auto& field) {
    if (!field) return;
    if constexpr (std::is_same_v<std::decay_t<decltype(*field)>, ScalarField>)
      arrays[name] = array_of(field->bricks, grids.size);
    else
      arrays[name] = array_of(*field, grids.size);
  };
  add("density", grids.density);
  add("temperature", grids.temperature);
  add("flame", grids.flame);
  add("color", grids.colour);
  add("velocity", grids.velocity);
  return arrays;
}

py::dict arrays_of(const TriangleMesh& mesh) {
  py::dict arrays;
  arrays["vertices"] = array_of<double>(mesh.positions);
  arrays["faces"] = array_of<int>(mesh.triangles);
  if (!mesh.normals.empty()) arrays["normals"] = array_of<float>(mesh.normals);
  if (!mesh.texcoords.empty()) arrays["texcoords"] = array_of<float>(mesh.texcoords);
  return arrays;
}

py::dict arrays_of(const InstanceList& places) {
  py::dict arrays;
  const auto count = static_cast<py::ssize_t>(places.matrices.size());
  py::array_t<double> matrices({count, py::ssize_t{4}, py::ssize_t{4}});
  for (size_t i = 0; i < places.matrices.size(); ++i)
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 4; ++column)
        matrices.mutable_at(static_cast<py::ssize_t>(i), row, column) = places.matrices[i][column][row];
  arrays["matrices"] = matrices;
  if (!places.densities.empty()) arrays["densities"] = py::array_t<double>(count, places.densities.data());
  if (!places.tints.empty()) arrays["tints"] = array_of<double>(places.tints);
  if (!places.time_offsets.empty()) arrays["time_offsets"] = py::array_t<double>(count, places.time_offsets.data());
  return arrays;
}

/// Tables, lists of tables and arrays, as the scene's text and its changes say.
py::dict settings(const SceneObject& scene) {
  const SceneSource source = scene.source();
  py::dict all = py::module_::import("tomllib").attr("loads")(to_str(source.as_file()));
  const auto add = [&](const char* list, size_t index, const py::dict& arrays) {
    const py::object entry = py::list(all[list])[index];
    entry.attr("update")(arrays);
  };
  for (const auto& [index, grids] : source.arrays.volumes) add("volumes", index, arrays_of(*grids));
  for (const auto& [index, places] : source.arrays.instances) add("instances", index, arrays_of(*places.list));
  for (const auto& [index, mesh] : source.arrays.meshes) add("surfaces", index, arrays_of(*mesh.mesh));
  return all;
}

py::tuple state_of(const SceneObject& scene) {
  const SceneSource source = scene.source();
  py::dict volumes, instances, meshes;
  for (const auto& [index, grids] : source.arrays.volumes) volumes[py::int_(index)] = arrays_of(*grids);
  for (const auto& [index, places] : source.arrays.instances) instances[py::int_(index)] = arrays_of(*places.list);
  for (const auto& [index, mesh] : source.arrays.meshes) meshes[py::int_(index)] = arrays_of(*mesh.mesh);
  const auto strings = [](const std::vector<std::string>& texts) {
    py::list list;
    for (const std::string& text : texts) list.append(to_str(text));
    return list;
  };
  return py::make_tuple(to_str(source.path.string()), to_str(source.text), strings(source.overrides),
                        strings(source.assumptions), volumes, meshes, instances);
}

ScenePointer scene_of_state(const py::tuple& state) {
  SceneSource source;
  source.path = to_text(state[0]);
  source.text = to_text(state[1]);
  for (const py::handle text : py::list(state[2])) source.overrides.push_back(to_text(text));
  for (const py::handle text : py::list(state[3])) source.assumptions.push_back(to_text(text));
  SceneChanges changes;
  for (const auto& [list, at] : {std::pair("volumes", 4), {"surfaces", 5}, {"instances", 6}})
    for (const auto& [index, arrays] : py::dict(state[static_cast<size_t>(at)]))
      for (const auto& [name, array] : py::dict(py::reinterpret_borrow<py::object>(arrays)))
        changes.take_array(list, index.cast<size_t>(), to_text(name), array);
  run_work({}, 0, [&](const Work& work) { changes.apply(source, work.task); });
  return std::make_shared<SceneObject>(std::move(source));
}

}  // namespace

SceneObject::SceneObject(SceneSource source) : source_(std::move(source)) {
  if (source_.density) cache_.know(source_.path, source_.density);
}

SceneSource SceneObject::source() const {
  const std::scoped_lock lock(mutex_);
  return source_;
}

void SceneObject::change(const std::function<void(SceneSource&)>& edit) {
  const std::scoped_lock one_at_a_time(changing_);
  SceneSource next = source();
  edit(next);
  const std::scoped_lock lock(mutex_);
  source_ = std::move(next);
}

SceneCache::Counts SceneObject::counts() const {
  const std::scoped_lock lock(mutex_);
  return counts_;
}

SceneUse::SceneUse(SceneObject& scene, const Task& task) : scene_(scene), lock_(scene.busy_, std::defer_lock) {
  while (!lock_.try_lock_for(std::chrono::milliseconds(50))) task.check();
}

SceneUse::~SceneUse() {
  const std::scoped_lock lock(scene_.mutex_);
  scene_.counts_ = scene_.cache_.counts();
}

Host SceneUse::host(const Work& work) {
  Host host = host_of(work);
  host.tell = [this, tell = host.tell](Host::Word word, const std::string& text) {
    if (word != Host::Word::kNote || scene_.told_.insert(text).second) tell(word, text);
  };
  return host;
}

void bind_scene(py::module_& module) {
  py::class_<SceneObject, ScenePointer> type(module, "Scene", help(embedded::help_scene_txt).c_str());
  type.def(py::init(&make_scene), py::arg("scene"));
  add_render(type, render_help(/*of_scene=*/true));
  type.def("explain", &explain, py::kw_only(), py::arg("spp") = py::none(), py::arg("layers") = py::none(),
           py::arg("statistics") = true, py::arg("clean") = false, kExplainHelp);
  type.def("set", &set,
           "Sets keys from now on: camera__fov=30, volumes__0__density=array, None leaving a key as it is.\n\n"
           "Nothing changes where one of them is wrong. Raises InputError.");
  type.def("copy", &copy_of, "A scene of its own with the same arrays, which are shared; nothing prepared yet.");
  type.def("__copy__", &copy_of);
  type.def("__deepcopy__", [](const SceneObject& self, const py::dict&) { return copy_of(self); });
  type.def(py::pickle(&state_of, &scene_of_state));
  type.def(
      "keys", [](const SceneObject& self) { return py::list(settings(self)); }, "Names of the scene's tables.");
  type.def("__getitem__", [](const SceneObject& self, const py::str& name) {
    const py::dict all = settings(self);
    if (!all.contains(name)) {
      std::vector<std::string> names;
      for (const auto& [key, value] : all) names.push_back(to_text(key));
      throw py::key_error(fmt::format("no table '{}'{}", to_text(name), suggestion(to_text(name), names)));
    }
    return py::object(all[name]);
  });
  type.def("__contains__",
           [](const SceneObject& self, const py::object& name) { return settings(self).contains(name); });
  type.def("__iter__", [](const SceneObject& self) { return py::iter(py::list(settings(self))); });
  type.def("__len__", [](const SceneObject& self) { return settings(self).size(); });
  type.def_property_readonly(
      "settings", &settings,
      "The scene as a dict, from which brume.Scene makes it again: what its text and the changes\n"
      "since say, absolute names of files, arrays as the render sees them, copied.");
  type.def_property_readonly(
      "text", [](const SceneObject& self) { return to_str(self.source().as_file()); },
      "The same as the text of a scene file, but for arrays, which no file holds.");
  type.def_property_readonly(
      "counts",
      [](const SceneObject& self) {
        const SceneCache::Counts counts = self.counts();
        py::dict dict;
        dict["files_read"] = counts.read;
        dict["scenes_prepared"] = counts.prepared;
        dict["lights_solved"] = counts.lights_solved;
        return dict;
      },
      kCountsHelp);
  type.def("__repr__", [](const SceneObject& self) {
    const SceneSource source = self.source();
    const SceneArrays& arrays = source.arrays;
    const size_t count = arrays.volumes.size() + arrays.instances.size() + arrays.meshes.size();
    return to_str(fmt::format("<brume.Scene {}{}>", source.path.filename().string(),
                              count ? fmt::format(", {} of arrays", count) : ""));
  });
}

}  // namespace brume::python
