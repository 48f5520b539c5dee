#include "render/scene/scene_io.h"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <sstream>

#include "base/error.h"
#include "base/file_kind.h"
#include "base/missing_file.h"
#include "base/text.h"
#include "render/scene/camera_keys.h"
#include "render/scene/instance_times.h"
#include "render/scene/scene_checks.h"
#include "render/scene/scene_fields.h"
#include "render/scene/scene_fingerprint.h"
#include "render/scene/toml_table.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

using Parser = TomlTable;

/// Refuses arrays for entries that a scene has not.
template <class Arrays>
void check_places(const toml::value& root, const char* name, const Arrays& arrays) {
  const size_t entries = root.contains(name) ? root.at(name).as_array().size() : 0;
  if (!arrays.empty() && arrays.rbegin()->first >= entries)
    throw InputError(fmt::format("{}.{}: arrays, but the scene has {} {}, counted from 0", name, arrays.rbegin()->first,
                                 entries, name));
}

constexpr auto kNothing = [](const auto&...) {};  // is done before a table is read, or checked after it

/// Takes a scene's text table by table, in the order of the calls.
class SceneTables {
 public:
  /// @param scene  whose frame names the files of all tables but its own
  SceneTables(const toml::value& root, const fs::path& folder, const Scene& scene)
      : root_(root), folder_(folder), scene_(scene) {}

  /// [name], where there is one.
  template <class Target, class Check>
  void section(const char* name, Target& target, const Check& check) {
    names_.push_back(name);
    if (root_.contains(name)) read(fmt::format("[{}]", name), root_.at(name), target, check, kNothing);
  }
  void section(const char* name, auto& target) { section(name, target, kNothing); }

  /// Every [[name]] that is enabled. @param begin  called before a table is read, with its number
  template <class Target, class Check, class Begin>
  void array(const char* name, std::vector<Target>& targets, const Check& check, const Begin& begin) {
    names_.push_back(name);
    if (!root_.contains(name)) return;
    const toml::value& entries = root_.at(name);
    if (!entries.is_array())
      fail_at(fmt::format("'{}' is {}", name, toml_type_name(entries)), entries, fmt::format("expected [[{}]]", name));
    for (size_t i = 0; i < entries.as_array().size(); ++i) {
      read(fmt::format("[[{}]]", name), entries.as_array()[i], targets.emplace_back(), check,
           [&](Parser& parser, Target& target) { begin(parser, target, i); });
      if (!targets.back().enabled) targets.pop_back();
    }
  }

  void name(std::string& name) {
    names_.push_back("name");
    if (!root_.contains("name")) return;
    if (!root_.at("name").is_string()) fail_at("'name' is not text", root_.at("name"), "expected text in quotes");
    name = toml::get<std::string>(root_.at("name"));
  }

  /// Refuses what none of the calls before has asked for.
  void reject_unknown() const {
    for (const auto& [key, value] : root_.as_table())
      if (std::find(names_.begin(), names_.end(), key) == names_.end())
        fail_at(fmt::format("unknown key '{}'{}", key, suggestion(key, names_)), value, "not part of a scene");
  }

 private:
  void read(const std::string& title, const toml::value& table, auto& target, const auto& check, const auto& begin) {
    Parser parser(table, title, folder_, scene_.render.frame);
    begin(parser, target);
    describe(parser, target);
    parser.reject_unknown();
    check(parser, target, table);
    parser.check_files();
  }

  const toml::value& root_;
  const fs::path folder_;
  const Scene& scene_;
  std::vector<std::string> names_;
};

/// What a front end has in memory for one entry of an array of tables; null: nothing.
template <class Arrays>
const typename Arrays::mapped_type* arrays_of(const Arrays& arrays, size_t entry) {
  const auto found = arrays.find(entry);
  return found == arrays.end() ? nullptr : &found->second;
}

/// @return for each volume of the text its place in scene.volumes, or kLeftOut
std::vector<size_t> read_volumes(SceneTables& tables, const SceneArrays& arrays, Scene& scene) {
  std::vector<size_t> places;
  size_t enabled = 0;
  tables.array(
      "volumes", scene.volumes,
      [&](Parser& parser, VolumeSettings& v, const toml::value& table) {
        check_volume(parser, v, table);
        if (v.enabled && v.time.given) set_frame(parser, v, table, scene);
        places.push_back(v.enabled ? enabled++ : kLeftOut);
      },
      [&](Parser& parser, VolumeSettings& v, size_t i) {
        const auto* const given = arrays_of(arrays.volumes, i);
        if (!given) return;
        v.grids = *given;
        describe(parser, v.placement);
      });
  return places;
}

void read_surfaces(SceneTables& tables, const SceneArrays& arrays, Scene& scene) {
  tables.array("surfaces", scene.surfaces, check_surface, [&](Parser& parser, SurfaceSettings& s, size_t i) {
    const auto* const given = arrays_of(arrays.meshes, i);
    if (!given) return;
    s.mesh = given->mesh;
    s.mesh_content = given->content;
    parser.provides("file");
  });
}

/// @param volumes  as read_volumes gives them
void read_instances(SceneTables& tables, const SceneArrays& arrays, const std::vector<size_t>& volumes, Scene& scene) {
  tables.array(
      "instances", scene.instances,
      [&](const Parser& parser, InstanceSettings& s, const toml::value& table) {
        check_instances(parser, s, table, volumes);
      },
      [&](Parser&, InstanceSettings& s, size_t i) {
        const auto* const given = arrays_of(arrays.instances, i);
        if (!given) return;
        s.arrays = given->list;
        s.arrays_content = given->content;
      });
  const auto place = [&](const InstanceSettings& s) { return volumes[static_cast<size_t>(s.volume)]; };
  std::erase_if(scene.instances, [&](const InstanceSettings& s) { return place(s) == kLeftOut; });
  for (InstanceSettings& s : scene.instances) s.volume = static_cast<int>(place(s));
}

Scene scene_from(std::istream& stream, const fs::path& path, std::span<const std::string> overrides,
                 const SceneArrays& arrays = {}, bool with_fingerprint = true) {
  toml::value root = parse_toml(stream, path.string());
  for (const std::string& assignment : overrides) apply_assignment(root, assignment);

  Scene scene;
  scene.path = path;
  scene.name = path.stem().string();
  SceneTables tables(root, path.parent_path(), scene);
  tables.name(scene.name);
  tables.section("render", scene.render, check_render);  // first: its frame names the files of the others
  scene.camera.matrices = arrays.camera;
  tables.section("camera", scene.camera, check_camera);
  tables.section("film", scene.film);
  tables.section("environment", scene.environment, check_environment);
  const std::vector<size_t> volumes = read_volumes(tables, arrays, scene);
  tables.array("lights", scene.lights, check_light, kNothing);
  read_surfaces(tables, arrays, scene);
  read_instances(tables, arrays, volumes, scene);
  set_instances_in_time(scene);
  check_places(root, "volumes", arrays.volumes);
  check_places(root, "instances", arrays.instances);
  check_places(root, "surfaces", arrays.meshes);
  tables.reject_unknown();

  if (!root.contains("camera") && !arrays.camera)
    throw InputError(fmt::format("{}: has no [camera]; expected position, look_at and fov", path.string()));
  // A picture with no factor set is taken as it is.
  const bool has_picture = !scene.environment.file.empty() || scene.environment.sky != "none";
  if (has_picture && !root.at("environment").contains("radiance")) scene.environment.radiance = dvec3(1);
  take_camera_of_frame(scene.camera, scene.render.frame);
  if (with_fingerprint) add_fingerprint(scene);
  return scene;
}

/// A scene file, opened. @throws InputError
std::ifstream open_scene(const fs::path& path) {
  std::error_code ignored;
  check_exists(path);
  if (fs::is_directory(path, ignored))
    throw InputError(fmt::format("{}: is a folder, expected a scene file (TOML)", path.string()));
  if (const KnownFile file = known_file(path); !file.what.empty())
    throw InputError(fmt::format("{}: is {}, expected a scene (TOML) that names it", path.string(), file.what));
  return std::ifstream(path, std::ios::binary);
}

}  // namespace

std::string read_scene_text(const fs::path& path) {
  std::ifstream stream = open_scene(path);
  return {std::istreambuf_iterator<char>(stream), {}};
}

Scene read_scene(const fs::path& path, std::span<const std::string> overrides) {
  std::ifstream stream = open_scene(path);
  return scene_from(stream, path, overrides);
}

Scene read_scene_alone(const fs::path& path, std::span<const std::string> overrides) {
  std::ifstream stream = open_scene(path);
  return scene_from(stream, path, overrides, {}, /*with_fingerprint=*/false);
}

Scene parse_scene(const std::string& text, const fs::path& path, std::span<const std::string> overrides,
                  const SceneArrays& arrays) {
  std::istringstream stream(text);
  return scene_from(stream, path, overrides, arrays);
}

Scene parse_scene_alone(const std::string& text, const fs::path& path, std::span<const std::string> overrides,
                        const SceneArrays& arrays) {
  std::istringstream stream(text);
  return scene_from(stream, path, overrides, arrays, /*with_fingerprint=*/false);
}

}  // namespace brume
