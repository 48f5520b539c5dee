#include "render/scene/scene_checks.h"

#include <fmt/format.h>

#include <bit>

#include "base/text.h"
#include "render/scene/light_groups.h"
#include "render/scene/volume_time.h"
#include "volume/placement.h"
#include "volume/volume_grids.h"

namespace brume {
namespace {

/// @param shines  whether it can be of a group
void check_group(const TomlTable& parser, const std::string& group, bool shines, const toml::value& table) {
  if (!parser.has("group")) return;
  if (const std::string wrong = what_forbids_group(group); !wrong.empty())
    fail_at(fmt::format("'group' {}", wrong), table.at("group"), "expected a name such as \"key\"");
  if (!shines) fail_at("'group' has no meaning where nothing shines", table.at("group"), "remove it");
}

/// Refuses keys that say again, or against it, what `other` says.
void refuse_beside(const TomlTable& parser, std::initializer_list<const char*> keys, const std::string& other,
                   const toml::value& table) {
  for (const char* key : keys)
    if (parser.has(key))
      fail_at(fmt::format("'{}' stands beside {}", key, other), table.at(key), "remove one of the two");
}

/// A volume of arrays: what they are stands for the keys that name a file's grids. @throws InputError
void take_arrays(TomlTable& parser, VolumeSettings& v, const toml::value& table) {
  const VolumeGrids& grids = *v.grids;
  for (const char* key :
       {"file", "grid", "albedo_grid", "albedo_file", "temperature_grid", "temperature_file", "flame_grid",
        "flame_file", "velocity_grid", "velocity_file", "convert_level_set", "paging", "time"})
    if (parser.has(key))
      fail_at(fmt::format("'{}' stands beside arrays", key), table.at(key),
              "remove one of the two: a volume is a file or arrays");
  if (v.shape != "grid")
    fail_at(fmt::format("arrays stand beside shape = \"{}\"", v.shape), table.at("shape"), "remove one of the two");
  if (grids.density) v.grid = "density";
  if (grids.temperature) v.temperature_grid = "temperature";
  if (grids.flame) v.flame_grid = "flame";
  if (grids.colour) v.albedo_grid = "color";
  if (grids.velocity) v.velocity_grid = "velocity";
}

/// A field that has a file of its own is there, under a usual name unless another is said.
void take_field_files(const TomlTable& parser, VolumeSettings& v, const toml::value& table) {
  struct Field {
    const char *file_key, *grid_key;
    std::string& grid;
  };
  for (const Field& field : {Field{"albedo_file", "albedo_grid", v.albedo_grid},
                             {"temperature_file", "temperature_grid", v.temperature_grid},
                             {"flame_file", "flame_grid", v.flame_grid},
                             {"velocity_file", "velocity_grid", v.velocity_grid}}) {
    if (!parser.has(field.file_key)) continue;
    if (!parser.has(field.grid_key)) field.grid = "auto";
    if (field.grid == "none")
      fail_at(fmt::format("'{}' stands beside {} = \"none\"", field.file_key, field.grid_key), table.at(field.file_key),
              "remove one of the two");
  }
}

void check_box(const VolumeSettings& v, const toml::value& table) {
  if (!glm::all(glm::lessThan(v.lo, v.hi))) fail_at("'lo' is not below 'hi'", table, "expected a box with a volume");
}

/// A layer has both corners of a box, or none and no end. @throws InputError
void check_layer(const TomlTable& parser, VolumeSettings& v, const toml::value& table) {
  if (parser.has("lo") != parser.has("hi"))
    fail_at(parser.has("lo") ? "'lo' stands without 'hi'" : "'hi' stands without 'lo'",
            table.at(parser.has("lo") ? "lo" : "hi"), "expected both, or neither: a layer without an end");
  if (parser.has("lo")) {
    check_box(v, table);
  } else {
    v.lo = v.hi = dvec3(0);
    for (const char* key : {"object_to_world", "object_to_world_end"})
      if (parser.has(key))
        fail_at(fmt::format("'{}' stands beside a layer without an end", key), table.at(key),
                "add lo and hi, or remove it: up and base_height say where the layer lies");
  }
  if (!v.up.empty() && (v.up.size() != 3 || !(glm::length(dvec3(v.up[0], v.up[1], v.up[2])) > 0)))
    fail_at("'up' is no direction", table.at("up"), "expected three numbers that are not all 0");
  if (v.emission != dvec3(0))
    fail_at("a layer cannot emit", table.at("emission"), "remove it: only shapes of even density and grids emit");
}

/// Refuses the parameters of other phase functions than the one that is set.
void check_phase(const TomlTable& parser, const VolumeSettings& v, const toml::value& table) {
  for (const auto& [key, phase] : {std::pair("g2", "two_lobes"),
                                   {"lobe_weight", "two_lobes"},
                                   {"droplet_diameter", "mie"},
                                   {"draine_alpha", "draine"},
                                   {"particle_index", "fournier_forand"},
                                   {"size_slope", "fournier_forand"}})
    if (parser.has(key) && v.phase != phase)
      fail_at(fmt::format("'{}' has no meaning for phase = \"{}\"", key, v.phase), table.at(key),
              fmt::format("set phase = \"{}\", or remove it", phase));
  if (v.phase == "rayleigh" || v.phase == "fournier_forand")
    refuse_beside(parser, {"g"}, fmt::format("phase = \"{}\"", v.phase), table);
  if (v.phase == "draine" && v.g < 0)
    fail_at("'g' of phase = \"draine\" is negative", table.at("g"), "expected 0 .. 0.999");
}

/// sigma_t and albedo of what is scattered and absorbed per length.
void set_coefficients(VolumeSettings& v, const dvec3& scattering, const dvec3& absorption) {
  v.sigma_t = scattering + absorption;
  for (int c = 0; c < 3; ++c) v.albedo[c] = v.sigma_t[c] > 0 ? scattering[c] / v.sigma_t[c] : 0.0;
}

/// The coefficients of Blender's shaders for volumes, by their parameters.
void take_preset(const TomlTable& parser, VolumeSettings& v, const toml::value& table) {
  if (v.preset == "none") {
    for (const char* key :
         {"color", "absorption_color", "scatter", "scatter_color", "transparent", "transparent_depth"})
      if (parser.has(key)) fail_at(fmt::format("'{}' belongs to a preset", key), table.at(key), "set preset = ... too");
    return;
  }
  refuse_beside(parser, {"sigma_t", "albedo", "sigma_a", "sigma_s"}, fmt::format("preset = \"{}\"", v.preset), table);
  const auto foreign = [&](std::initializer_list<const char*> keys) {
    for (const char* key : keys)
      if (parser.has(key))
        fail_at(fmt::format("'{}' is no parameter of preset \"{}\"", key, v.preset), table.at(key), "remove it");
  };
  if (v.preset == "principled") {
    foreign({"scatter", "scatter_color", "transparent", "transparent_depth"});
    set_coefficients(v, v.color, (dvec3(1) - v.color) * (dvec3(1) - glm::sqrt(v.absorption_color)));
    if (!parser.has("blackbody_law")) v.blackbody_law = "stefan_boltzmann";
    if (!parser.has("temperature_scale")) v.temperature_scale = 1000;
  } else {
    foreign({"color", "absorption_color"});
    const dvec3 extinction = -glm::log(v.transparent) / v.transparent_depth;
    const dvec3 scattering = extinction * v.scatter * v.scatter_color;
    set_coefficients(v, scattering, extinction - scattering);
  }
}

/// Whichever way the coefficients are given, they become sigma_t and albedo.
void take_coefficients(const TomlTable& parser, VolumeSettings& v, const toml::value& table) {
  if (parser.has("sigma_a") || parser.has("sigma_s")) {
    refuse_beside(parser, {"sigma_t", "albedo"}, "sigma_a and sigma_s", table);
    v.sigma_t = v.sigma_a + v.sigma_s;
    // Sums that differ by their rounding alone, as of a colour and the rest to 1, are one extinction: that costs less.
    const double most = max_component(v.sigma_t), least = -max_component(-v.sigma_t);
    if (most - least <= 1e-6 * most) v.sigma_t = dvec3(0.5 * (most + least));
    for (int c = 0; c < 3; ++c) v.albedo[c] = v.sigma_t[c] > 0 ? v.sigma_s[c] / v.sigma_t[c] : 0.0;
  }
  take_preset(parser, v, table);
  v.sigma_t *= v.density;
  v.emission *= v.density;
  v.density = 1;
}

/// What belongs to another shape than the one that is set.
void check_shape(const TomlTable& parser, VolumeSettings& v, const toml::value& table) {
  if (v.shape == "grid" && v.file.empty() && !v.grids)
    fail_at("[[volumes]] has no 'file'", table, "add file = ... here: OpenVDB file");
  if (v.shape != "grid") {
    refuse_beside(parser,
                  {"file", "grid", "albedo_grid", "albedo_file", "temperature_grid", "temperature_file", "flame_grid",
                   "flame_file", "velocity_grid", "velocity_file", "time", "detail"},
                  fmt::format("shape = \"{}\"", v.shape), table);
    if (v.shape == "everywhere")
      refuse_beside(parser, {"lo", "hi", "object_to_world", "object_to_world_end"}, "shape = \"everywhere\"", table);
    if (v.shape == "layer")
      check_layer(parser, v, table);
    else
      check_box(v, table);
  }
  take_field_files(parser, v, table);
  if (v.shape != "layer")
    for (const char* key : {"up", "base_height", "scale_height"})
      if (parser.has(key))
        fail_at(fmt::format("'{}' has no meaning for shape = \"{}\"", key, v.shape), table.at(key),
                "set shape = \"layer\", or remove it");
}

}  // namespace

void check_render(const TomlTable&, const RenderSettings& r, const toml::value& table) {
  if (!std::has_single_bit(static_cast<unsigned>(r.cell_size)))
    fail_at(fmt::format("'cell_size' is {}", r.cell_size), table.at("cell_size"), "expected 2, 4, 8, 16 or 32");
}

void check_camera(const TomlTable& parser, const CameraSettings& c, const toml::value& table) {
  if (!c.keys.empty())
    for (const char* key : {"position", "look_at", "position_end", "look_at_end", "up_end", "from_exr"})
      if (parser.has(key))
        fail_at(fmt::format("'{}' stands beside 'keys'", key), table.at(key), "remove one of the two");
  if (!c.from_exr.empty())
    for (const char* key : {"shift", "pixel_aspect"})
      if (parser.has(key))
        fail_at(fmt::format("'{}' stands beside 'from_exr', whose header holds it", key), table.at(key), "remove it");
  if (c.from_exr.empty() && !c.matrices && c.keys.empty())
    for (const char* key : {"position", "look_at"})
      if (!parser.has(key))
        fail_at(fmt::format("[camera] has no '{}'", key), table, fmt::format("add {} = ... here", key));
  if (c.blades == 1 || c.blades == 2) fail_at("'blades' is too few", table.at("blades"), "expected 0, or 3 and more");
  if (c.shutter.y < c.shutter.x)
    fail_at("the shutter closes before it opens", table.at("shutter"), "expected [open, close]");
}
void check_environment(const TomlTable& parser, const EnvironmentSettings& e, const toml::value& table) {
  check_group(parser, e.group, true, table);
  if (!(glm::length(e.up) > 0)) fail_at("'up' is zero", table.at("up"), "expected a direction");
  if (e.sky != "atmosphere")
    for (const char* key : {"altitude", "air", "metres_per_unit"})
      if (parser.has(key))
        fail_at(fmt::format("'{}' has no meaning for sky = \"{}\"", key, e.sky), table.at(key),
                "set sky = \"atmosphere\", or remove it");
  if (e.sky == "none") return;
  if (parser.has("file")) fail_at("'file' stands beside 'sky'", table.at("file"), "remove one of the two");
  if (e.sky == "atmosphere") {
    const double sine = glm::dot(glm::normalize(e.sun_direction), glm::normalize(e.up));
    if (!(sine > -0.1046))  // sin 6 degrees, and rounding
      fail_at("'sun_direction' lies more than 6 degrees below the horizon",
              parser.has("sun_direction") ? table.at("sun_direction") : table,
              "expected a direction above that: there is no light of the night in the model");
    return;
  }
  if (!(glm::dot(e.sun_direction, e.up) > 0))
    fail_at("'sun_direction' lies below the horizon", parser.has("sun_direction") ? table.at("sun_direction") : table,
            "expected a direction above it: the model is one of daylight");
}

void check_light(const TomlTable& parser, const LightSettings& light, const toml::value& table) {
  check_group(parser, light.group, true, table);
  const auto need = [&](std::initializer_list<const char*> keys) {
    for (const char* key : keys)
      if (!parser.has(key))
        fail_at(fmt::format("a {} light has no '{}'", light.type, key), table, fmt::format("add {} = ... here", key));
  };
  const auto need_length = [&](const char* key, double length, const char* expected) {
    if (!(length > 0)) fail_at(fmt::format("a {} light's {} is zero", light.type, key), table.at(key), expected);
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

void check_volume(TomlTable& parser, VolumeSettings& v, const toml::value& table) {
  if (v.grids) take_arrays(parser, v, table);
  check_shape(parser, v, table);
  check_phase(parser, v, table);
  const bool emits = v.emission != dvec3(0) || v.temperature_grid != "none" || v.flame_grid != "none";
  take_coefficients(parser, v, table);
  check_group(parser, v.group, emits, table);
}

void set_frame(TomlTable& parser, VolumeSettings& v, const toml::value& table, const Scene& scene) {
  const VolumeTime& t = v.time;
  const toml::value& time = table.at("time");
  for (const char* key : {"fps", "scene_fps"})
    if (!t.frame.empty() && time.contains(key))
      fail_at(fmt::format("'{}' stands beside 'frame'", key), time.at(key), "remove one of the two");
  if (time.contains("scene_fps") && !time.contains("fps"))
    fail_at("'scene_fps' stands without 'fps'", time.at("scene_fps"), "add fps = ...: frames of the files per second");
  if (t.first >= 0 && t.last >= 0 && t.last < t.first)
    fail_at(fmt::format("'last' is {}, before first = {}", t.last, t.first), time.at("last"),
            "expected a frame after it");
  for (const auto& [key, file] : kVolumeFiles) v.moment.names[key] = parser.name_of_file(key);
  set_in_time(v, frames_in_time(v), scene.render.frame, scene.camera.shutter,
              [&](const std::string& key, const std::string& message, const std::string& expected) {
                fail_at(message, table.at(key), expected);
              });
  for (const auto& [key, file] : kVolumeFiles) parser.take_file(key, v.*file);
}

void check_surface(const TomlTable& parser, SurfaceSettings& s, const toml::value& table) {
  if (s.mesh && parser.has("file"))
    fail_at("'file' stands beside arrays", table.at("file"), "remove one of the two: a mesh is a file or arrays");
  if (s.material == "dielectric" && !parser.has("albedo")) s.albedo = dvec3(1);
  if (s.material == "diffuse")
    for (const char* key : {"roughness", "ior"})
      if (parser.has(key))
        fail_at(fmt::format("'{}' has no meaning for a diffuse surface", key), table.at(key), "remove it");
  if (s.shadow == "straight" && (s.material != "dielectric" || s.roughness > 0))
    fail_at("'shadow' is straight", table.at("shadow"),
            "expected so only for material = \"dielectric\", roughness = 0");
  const bool fresnel = s.material == "dielectric" || s.material == "coated";
  for (const auto& [key, means] :
       {std::pair("edge_albedo", s.material == "conductor"), std::pair("reflection_tint", fresnel)})
    if (!means && parser.has(key))
      fail_at(fmt::format("'{}' has no meaning for a {} surface", key, s.material), table.at(key), "remove it");
  if (s.translucence != dvec3(0) && s.material != "diffuse")
    fail_at(fmt::format("'translucence' has no meaning for a {} surface", s.material), table.at("translucence"),
            "remove it");
  if (const double all = max_component(s.albedo + s.translucence); all > 1 + 1e-9)
    fail_at(fmt::format("albedo and translucence are {:.6g} together", all), table.at("translucence"),
            "expected at most 1");
  check_group(parser, s.group, s.radiance != dvec3(0), table);
  if (!s.radiance_texture.empty() && s.radiance == dvec3(0))
    fail_at("'radiance_texture' has no meaning without 'radiance'", table.at("radiance_texture"),
            "set radiance, or remove it");
  if (s.two_sided && s.radiance == dvec3(0))
    fail_at("'two_sided' has no meaning without 'radiance'", table.at("two_sided"), "set radiance, or remove it");
  if (s.object_to_world_end != dmat4(0.0) && s.radiance != dvec3(0))
    fail_at("a surface that emits cannot move", table.at("object_to_world_end"),
            "remove object_to_world_end or radiance");
  if (s.role != "visible" && s.radiance != dvec3(0))
    fail_at(fmt::format("a {} cannot emit", s.role), table.at("radiance"), "remove radiance or role");
}

void check_instances(const TomlTable& parser, const InstanceSettings& s, const toml::value& table,
                     const std::vector<size_t>& volumes) {
  if (parser.has("file") && parser.has("matrices"))
    fail_at("'file' stands beside 'matrices'", table.at("file"), "remove one of the two");
  for (const char* key : {"file", "matrices"})
    if (s.arrays && parser.has(key))
      fail_at(fmt::format("'{}' stands beside arrays", key), table.at(key), "remove one of the two");
  if (!parser.has("file") && !parser.has("matrices") && !s.arrays)
    fail_at("[[instances]] has neither 'matrices' nor 'file'", table, "add one of them: where the volume stands");
  if (static_cast<size_t>(s.volume) >= volumes.size())
    fail_at(fmt::format("'volume' is {}", s.volume), parser.has("volume") ? table.at("volume") : table,
            volumes.empty()
                ? "the scene has no [[volumes]]"
                : fmt::format("expected 0 .. {}: the scene has {} [[volumes]]", volumes.size() - 1, volumes.size()));
  for (size_t i = 0; i < s.matrices.size(); ++i)
    if (const std::string wrong = what_forbids_transform(s.matrices[i]); !wrong.empty())
      fail_at(fmt::format("matrix {} of 'matrices' is {}", i, wrong), table.at("matrices").as_array()[i],
              "expected an invertible affine map, its last row 0, 0, 0, 1");
  if (const std::string wrong = what_forbids_transform(s.object_to_world); !wrong.empty())
    fail_at(fmt::format("'object_to_world' is {}", wrong), table.at("object_to_world"),
            "expected an invertible affine map, its last row 0, 0, 0, 1");
}

}  // namespace brume
