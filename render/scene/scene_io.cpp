#include "render/scene/scene_io.h"

#include <fmt/format.h>

#include <fstream>
#include <sstream>
#include <toml.hpp>

#include "base/error.h"
#include "base/text.h"
#include "render/scene/scene_fields.h"
#include "render/scene/scene_fingerprint.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const std::string& message, const toml::value& at, const std::string& expected) {
  std::string text = toml::format_error(message, at, expected);
  if (text.starts_with("[error] ")) text.erase(0, 8);
  throw InputError(text);
}

const char* type_name(const toml::value& v) {
  switch (v.type()) {
    case toml::value_t::boolean:
      return "a boolean";
    case toml::value_t::integer:
      return "an integer";
    case toml::value_t::floating:
      return "a number";
    case toml::value_t::string:
      return "text";
    case toml::value_t::array:
      return "an array";
    case toml::value_t::table:
      return "a table";
    default:
      return "a date or time";
  }
}

std::string range_text(const Field& field) {
  if (field.lowest == -kInfinity && field.highest == kInfinity) return "";
  if (field.highest == kInfinity) return fmt::format(", at least {}", field.lowest);
  return fmt::format(" in {} .. {}", field.lowest, field.highest);
}

/// Reads one table's keys into their targets.
class Parser {
 public:
  Parser(const toml::value& table, std::string where, const fs::path& folder)
      : table_(table), where_(std::move(where)), folder_(folder) {
    if (!table.is_table()) fail(where_ + " is " + type_name(table), table, "expected a table");
  }

  template <class T>
  void operator()(const Field& field, T& target) {
    known_.push_back(field.key);
    const auto& entries = table_.as_table();
    const auto it = entries.find(field.key);
    if (it != entries.end()) {
      read(field, it->second, target);
    } else if (field.required) {
      fail(fmt::format("{} has no '{}'", where_, field.key), table_,
           fmt::format("add {} = ... here: {}", field.key, field.help));
    }
  }

  bool has(const char* key) const { return table_.contains(key); }

  void reject_unknown() const {
    for (const auto& [key, value] : table_.as_table())
      if (std::find(known_.begin(), known_.end(), key) == known_.end())
        fail(fmt::format("unknown key '{}' in {}{}", key, where_, suggestion(key, known_)), value,
             "not a key of " + where_);
  }

  /// Last, so that what the table itself gets wrong is said first.
  void check_files() const {
    std::error_code ignored;
    for (const auto& [key, path] : files_)
      if (!fs::exists(path, ignored))
        fail(fmt::format("'{}' of {} is {}: no such file", key, where_, path.string()), table_.at(key),
             "expected a file; its path starts at the scene's folder");
  }

 private:
  static double number(const Field& field, const toml::value& v) {
    double x;
    if (v.is_integer())
      x = static_cast<double>(v.as_integer());
    else if (v.is_floating())
      x = v.as_floating();
    else
      fail(fmt::format("'{}' is {}", field.key, type_name(v)), v, "expected a number" + range_text(field));
    if (!(x >= field.lowest && x <= field.highest) || !std::isfinite(x))
      fail(fmt::format("'{}' is out of range", field.key), v, "expected a finite number" + range_text(field));
    return x;
  }
  static void read(const Field& field, const toml::value& v, double& target) { target = number(field, v); }
  template <class Integer>
  requires std::is_integral_v<Integer>
  static void read(const Field& field, const toml::value& v, Integer& target) {
    if (!v.is_integer())
      fail(fmt::format("'{}' is {}", field.key, type_name(v)), v, "expected an integer" + range_text(field));
    number(field, v);
    target = static_cast<Integer>(v.as_integer());
  }
  static void read(const Field& field, const toml::value& v, bool& target) {
    if (!v.is_boolean()) fail(fmt::format("'{}' is {}", field.key, type_name(v)), v, "expected true or false");
    target = v.as_boolean();
  }
  static void read(const Field& field, const toml::value& v, std::string& target) {
    if (!v.is_string()) fail(fmt::format("'{}' is {}", field.key, type_name(v)), v, "expected text in quotes");
    target = v.as_string().str;
    if (!field.choices.empty() && std::find(field.choices.begin(), field.choices.end(), target) == field.choices.end())
      fail(fmt::format("'{}' cannot be '{}'{}", field.key, target, suggestion(target, field.choices)), v,
           "expected one of these");
  }
  void read(const Field& field, const toml::value& v, fs::path& target) {
    std::string text;
    read(field, v, text);
    target = text.empty() ? fs::path() : folder_ / text;
    if (!text.empty()) files_.emplace_back(field.key, target);
  }
  static void read(const Field& field, const toml::value& v, dvec3& target) {
    const std::string expected = "expected [x, y, z]" + range_text(field);
    if (v.is_integer() || v.is_floating()) {
      if (std::string(field.unit).empty() || std::string(field.unit) == "scene units")
        fail(fmt::format("'{}' is a number", field.key), v, expected);
      target = dvec3(number(field, v));  // a grey colour
      return;
    }
    if (!v.is_array() || v.as_array().size() != 3)
      fail(fmt::format("'{}' is {}", field.key,
                       v.is_array() ? fmt::format("an array of {}", v.as_array().size()) : type_name(v)),
           v, expected);
    for (int i = 0; i < 3; ++i) target[i] = number(field, v.as_array()[static_cast<size_t>(i)]);
  }
  static void read(const Field& field, const toml::value& v, dvec2& target) {
    if (!v.is_array() || v.as_array().size() != 2)
      fail(fmt::format("'{}' is not two numbers", field.key), v, "expected [first, second]" + range_text(field));
    for (int i = 0; i < 2; ++i) target[i] = number(field, v.as_array()[static_cast<size_t>(i)]);
  }
  static void read(const Field& field, const toml::value& v, std::vector<double>& target) {
    if (!v.is_array() || (!v.as_array().empty() && v.as_array().size() != 3))
      fail(fmt::format("'{}' is not three numbers", field.key), v, "expected [x, y, z]" + range_text(field));
    for (const toml::value& entry : v.as_array()) target.push_back(number(field, entry));
  }
  static void read(const Field& field, const toml::value& v, std::vector<std::vector<double>>& target) {
    const size_t columns = std::string(field.key) == "flame_ramp" ? 4 : 2;
    const std::string expected = fmt::format("expected at least two rows of {} numbers, rising in the first", columns);
    if (!v.is_array()) fail(fmt::format("'{}' is {}", field.key, type_name(v)), v, expected);
    for (const toml::value& row : v.as_array()) {
      if (!row.is_array() || row.as_array().size() != columns)
        fail(fmt::format("'{}' has a row that is not {} numbers", field.key, columns), row, expected);
      std::vector<double> numbers;
      for (const toml::value& entry : row.as_array()) numbers.push_back(number(field, entry));
      if (!target.empty() && !(numbers[0] > target.back()[0]))
        fail(fmt::format("'{}' does not rise", field.key), row, expected);
      for (size_t i = 1; i < columns; ++i)
        if (numbers[i] < 0) fail(fmt::format("'{}' has a negative result", field.key), row, expected);
      target.push_back(numbers);
    }
    if (target.size() == 1) fail(fmt::format("'{}' has one row", field.key), v, expected);
  }
  static void read(const Field& field, const toml::value& v, dmat4& target) {
    const std::string expected = "expected four rows of four numbers";
    if (!v.is_array() || v.as_array().size() != 4)
      fail(fmt::format("'{}' is not a 4 x 4 matrix", field.key), v, expected);
    for (int row = 0; row < 4; ++row) {
      const toml::value& line = v.as_array()[static_cast<size_t>(row)];
      if (!line.is_array() || line.as_array().size() != 4)
        fail(fmt::format("'{}' has a row that is not four numbers", field.key), line, expected);
      for (int column = 0; column < 4; ++column)
        target[column][row] = number(field, line.as_array()[static_cast<size_t>(column)]);
    }
  }

  const toml::value& table_;
  std::string where_;
  fs::path folder_;
  std::vector<std::string> known_;
  std::vector<std::pair<std::string, fs::path>> files_;
};

toml::value parse(std::istream& stream, const std::string& name) {
  try {
    return toml::parse(stream, name);
  } catch (const toml::syntax_error& error) {
    std::string text = error.what();
    if (text.starts_with("[error] ")) text.erase(0, 8);
    throw InputError(text);
  } catch (const std::exception& error) {
    throw InputError(fmt::format("{}: {}", name, error.what()));
  }
}

void apply_override(toml::value& root, const std::string& assignment) {
  const std::string source = "-D " + assignment;
  const size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0)
    throw InputError(fmt::format("{}: expected -D table.key=value", source));
  const std::string text = assignment.substr(equals + 1);
  toml::value value;
  try {
    std::istringstream stream("value = " + text);
    value = parse(stream, source).at("value");
  } catch (const InputError&) {
    // Text without its quotes.
    if (text.find('\'') != std::string::npos || text.find('\n') != std::string::npos) throw;
    std::istringstream stream("value = '" + text + "'");
    value = parse(stream, source).at("value");
  }
  toml::value* at = &root;
  const std::vector<std::string> keys = split(assignment.substr(0, equals), '.');
  for (const std::string& key : keys) {
    if (at->is_array()) {
      char* end = nullptr;
      const size_t index = std::strtoul(key.c_str(), &end, 10);
      if (*end != '\0' || key.empty() || index >= at->as_array().size())
        throw InputError(
            fmt::format("{}: '{}' is not one of the {} entries, counted from 0", source, key, at->as_array().size()));
      at = &at->as_array()[index];
    } else if (at->is_table()) {
      at = &at->as_table().try_emplace(key, toml::table()).first->second;
    } else {
      throw InputError(fmt::format("{}: '{}' is inside {}, not a table", source, key, type_name(*at)));
    }
  }
  *at = value;
}

void check_light(Parser& parser, LightSettings& light, const toml::value& table) {
  const auto need = [&](std::initializer_list<const char*> keys) {
    for (const char* key : keys)
      if (!parser.has(key))
        fail(fmt::format("a {} light has no '{}'", light.type, key), table, fmt::format("add {} = ... here", key));
  };
  const auto need_length = [&](const char* key, double length, const char* expected) {
    if (!(length > 0)) fail(fmt::format("a {} light's {} is zero", light.type, key), table.at(key), expected);
  };
  if (light.type == "sun") {
    need({"direction", "irradiance"});
    need_length("direction", glm::length(light.direction), "expected the direction towards the sun");
  } else if (light.type == "sphere") {
    need({"position", "radius", "radiance"});
    need_length("radius", light.radius, "expected a length above 0");
  } else if (light.type == "rectangle") {
    need({"position", "edge_x", "edge_y", "radiance"});
    need_length("edge_x", glm::length(glm::cross(light.edge_x, light.edge_y)), "expected two edges that span an area");
  } else {
    need({"position", "intensity"});
    if (light.type == "spot") {
      need({"direction"});
      need_length("direction", glm::length(light.direction), "expected where the spot shines");
    }
  }
}

/// Whichever way the coefficients are given, they become sigma_t and albedo.
void check_render(const Parser&, const RenderSettings& r, const toml::value& table) {
  if (!std::has_single_bit(static_cast<unsigned>(r.cell_size)))
    fail(fmt::format("'cell_size' is {}", r.cell_size), table.at("cell_size"), "expected 2, 4, 8, 16 or 32");
}

void check_volume(Parser& parser, VolumeSettings& v, const toml::value& table) {
  const auto conflict = [&](std::initializer_list<const char*> keys, const std::string& with) {
    for (const char* key : keys)
      if (parser.has(key))
        fail(fmt::format("'{}' stands beside {}", key, with), table.at(key), "remove one of the two");
  };
  const bool by_parts = parser.has("sigma_a") || parser.has("sigma_s");
  if (v.shape == "grid" && v.file.empty())
    fail("[[volumes]] has no 'file'", table, "add file = ... here: OpenVDB file");
  if (v.shape != "grid") {
    conflict({"file", "grid", "albedo_grid", "temperature_grid", "flame_grid", "velocity_grid"},
             fmt::format("shape = \"{}\"", v.shape));
    if (!glm::all(glm::lessThan(v.lo, v.hi))) fail("'lo' is not below 'hi'", table, "expected a box with a volume");
  }
  for (const auto& [key, phase] :
       {std::pair("g2", "two_lobes"), {"lobe_weight", "two_lobes"}, {"droplet_diameter", "mie"}})
    if (parser.has(key) && v.phase != phase)
      fail(fmt::format("'{}' has no meaning for phase = \"{}\"", key, v.phase), table.at(key),
           fmt::format("set phase = \"{}\", or remove it", phase));
  if (by_parts) {
    conflict({"sigma_t", "albedo"}, "sigma_a and sigma_s");
    v.sigma_t = v.sigma_a + v.sigma_s;
    for (int c = 0; c < 3; ++c) v.albedo[c] = v.sigma_t[c] > 0 ? v.sigma_s[c] / v.sigma_t[c] : 0.0;
  }
  if (v.preset != "none") {
    conflict({"sigma_t", "albedo", "sigma_a", "sigma_s"}, fmt::format("preset = \"{}\"", v.preset));
    const auto foreign = [&](std::initializer_list<const char*> keys) {
      for (const char* key : keys)
        if (parser.has(key))
          fail(fmt::format("'{}' is no parameter of preset \"{}\"", key, v.preset), table.at(key), "remove it");
    };
    dvec3 scattering, absorption;
    if (v.preset == "principled") {
      foreign({"scatter", "scatter_color", "transparent", "transparent_depth"});
      scattering = v.color;
      absorption = (dvec3(1) - v.color) * (dvec3(1) - glm::sqrt(v.absorption_color));
      if (!parser.has("blackbody_law")) v.blackbody_law = "stefan_boltzmann";
      if (!parser.has("temperature_scale")) v.temperature_scale = 1000;
    } else {
      foreign({"color", "absorption_color"});
      const dvec3 extinction = -glm::log(v.transparent) / v.transparent_depth;
      scattering = extinction * v.scatter * v.scatter_color;
      absorption = extinction - scattering;
    }
    v.sigma_t = scattering + absorption;
    for (int c = 0; c < 3; ++c) v.albedo[c] = v.sigma_t[c] > 0 ? scattering[c] / v.sigma_t[c] : 0.0;
  } else {
    for (const char* key :
         {"color", "absorption_color", "scatter", "scatter_color", "transparent", "transparent_depth"})
      if (parser.has(key)) fail(fmt::format("'{}' belongs to a preset", key), table.at(key), "set preset = ... too");
  }
  v.sigma_t *= v.density;
  v.emission *= v.density;
  v.density = 1;
}

void check_environment(const Parser& parser, const EnvironmentSettings& e, const toml::value& table) {
  if (!(glm::length(e.up) > 0)) fail("'up' is zero", table.at("up"), "expected a direction");
  if (e.sky == "none") return;
  if (parser.has("file")) fail("'file' stands beside 'sky'", table.at("file"), "remove one of the two");
  if (!(glm::dot(e.sun_direction, e.up) > 0))
    fail("'sun_direction' lies below the horizon", parser.has("sun_direction") ? table.at("sun_direction") : table,
         "expected a direction above it: the model is one of daylight");
}

void check_surface(Parser& parser, SurfaceSettings& s, const toml::value& table) {
  if (s.material == "dielectric" && !parser.has("albedo")) s.albedo = dvec3(1);
  if (s.material == "diffuse")
    for (const char* key : {"roughness", "ior"})
      if (parser.has(key))
        fail(fmt::format("'{}' has no meaning for a diffuse surface", key), table.at(key), "remove it");
  if (s.shadow == "straight" && (s.material != "dielectric" || s.roughness > 0))
    fail("'shadow' is straight", table.at("shadow"), "expected so only for material = \"dielectric\", roughness = 0");
  if (s.role != "visible" && s.radiance != dvec3(0))
    fail(fmt::format("a {} cannot emit", s.role), table.at("radiance"), "remove radiance or role");
}

void check_camera(const Parser& parser, const CameraSettings& c, const toml::value& table) {
  if (c.from_exr.empty())
    for (const char* key : {"position", "look_at"})
      if (!parser.has(key))
        fail(fmt::format("[camera] has no '{}'", key), table, fmt::format("add {} = ... here", key));
  if (c.blades == 1 || c.blades == 2) fail("'blades' is too few", table.at("blades"), "expected 0, or 3 and more");
  if (c.shutter.y < c.shutter.x)
    fail("the shutter closes before it opens", table.at("shutter"), "expected [open, close]");
}

Scene scene_from(std::istream& stream, const fs::path& path, std::span<const std::string> overrides) {
  toml::value root = parse(stream, path.string());
  for (const std::string& assignment : overrides) apply_override(root, assignment);

  Scene scene;
  scene.path = path;
  scene.name = path.stem().string();
  const fs::path folder = path.parent_path();
  std::vector<std::string> sections = {"name"};
  const auto section = [&](const char* name, auto& target, const auto& check) {
    sections.push_back(name);
    if (!root.contains(name)) return;
    Parser parser(root.at(name), fmt::format("[{}]", name), folder);
    describe(parser, target);
    parser.reject_unknown();
    check(parser, target, root.at(name));
    parser.check_files();
  };
  const auto no_check = [](const auto&...) {};
  const auto array = [&](const char* name, auto& target, const auto& check) {
    sections.push_back(name);
    if (!root.contains(name)) return;
    const toml::value& entries = root.at(name);
    if (!entries.is_array())
      fail(fmt::format("'{}' is {}", name, type_name(entries)), entries, fmt::format("expected [[{}]]", name));
    for (const toml::value& entry : entries.as_array()) {
      Parser parser(entry, fmt::format("[[{}]]", name), folder);
      describe(parser, target.emplace_back());
      parser.reject_unknown();
      check(parser, target.back(), entry);
      parser.check_files();
    }
  };
  if (root.contains("name")) {
    if (!root.at("name").is_string()) fail("'name' is not text", root.at("name"), "expected text in quotes");
    scene.name = root.at("name").as_string().str;
  }
  section("camera", scene.camera, check_camera);
  section("film", scene.film, no_check);
  section("render", scene.render, check_render);
  section("environment", scene.environment, check_environment);
  array("volumes", scene.volumes, check_volume);
  array("lights", scene.lights, check_light);
  array("surfaces", scene.surfaces, check_surface);
  for (const auto& [key, value] : root.as_table())
    if (std::find(sections.begin(), sections.end(), key) == sections.end())
      fail(fmt::format("unknown key '{}'{}", key, suggestion(key, sections)), value, "not part of a scene");

  if (!root.contains("camera"))
    throw InputError(fmt::format("{}: has no [camera]; expected position, look_at and fov", path.string()));
  // A picture with no factor set is taken as it is.
  const bool has_picture = !scene.environment.file.empty() || scene.environment.sky != "none";
  if (has_picture && !root.at("environment").contains("radiance")) scene.environment.radiance = dvec3(1);
  add_fingerprint(scene);
  return scene;
}

}  // namespace

Scene read_scene(const fs::path& path, std::span<const std::string> overrides) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) throw InputError(fmt::format("{}: no such file", path.string()));
  if (fs::is_directory(path, ignored))
    throw InputError(fmt::format("{}: is a folder, expected a scene file (TOML)", path.string()));
  std::ifstream stream(path, std::ios::binary);
  char magic[4] = {};
  stream.read(magic, sizeof magic);
  for (const auto& [bytes, what] : {std::pair(std::string_view(" BDV", 4), "an OpenVDB file"),
                                    {std::string_view("\x76\x2f\x31\x01", 4), "an OpenEXR file"},
                                    {std::string_view("\x89PNG", 4), "a PNG picture"}})
    if (std::string_view(magic, 4) == bytes)
      throw InputError(fmt::format("{}: is {}, expected a scene (TOML) that names it", path.string(), what));
  stream.clear();
  stream.seekg(0);
  return scene_from(stream, path, overrides);
}

Scene parse_scene(const std::string& text, const fs::path& path, std::span<const std::string> overrides) {
  std::istringstream stream(text);
  return scene_from(stream, path, overrides);
}

}  // namespace brume
