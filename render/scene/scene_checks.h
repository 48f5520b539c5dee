#pragma once
#include <cstddef>
#include <vector>

#include "render/scene/scene.h"
#include "render/scene/toml_table.h"

namespace brume {

// What one table of a scene must hold beyond the types and ranges of its keys: keys that need or exclude each other,
// and what they become together. Each takes the table's reader, the settings that it has read and the table, for the
// line.
// @throws InputError with that line

void check_render(const TomlTable& parser, const RenderSettings& r, const toml::value& table);
void check_camera(const TomlTable& parser, const CameraSettings& c, const toml::value& table);
void check_environment(const TomlTable& parser, const EnvironmentSettings& e, const toml::value& table);
void check_light(const TomlTable& parser, const LightSettings& light, const toml::value& table);
void check_surface(const TomlTable& parser, SurfaceSettings& s, const toml::value& table);

/// Whichever way the coefficients are given, they become sigma_t and albedo.
void check_volume(TomlTable& parser, VolumeSettings& v, const toml::value& table);

/// Has a volume show the frame of its sequence that its table `time` says.
void set_frame(TomlTable& parser, VolumeSettings& v, const toml::value& table, const Scene& scene);

constexpr size_t kLeftOut = static_cast<size_t>(-1);  ///< place of a volume that is not enabled

/// @param volumes  of the scene's text, by number: their places in Scene::volumes, or kLeftOut
void check_instances(const TomlTable& parser, const InstanceSettings& s, const toml::value& table,
                     const std::vector<size_t>& volumes);

}  // namespace brume
