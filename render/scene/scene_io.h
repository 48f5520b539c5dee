#pragma once
#include <filesystem>
#include <span>
#include <string>

#include "render/scene/scene.h"

namespace brume {

/// Reads a scene. Relative paths in it start at the scene file's folder.
/// @param overrides  "camera.fov=30", "volumes.0.sigma_t=5": as apply_assignment
/// @throws InputError with the line at fault underlined: syntax, unknown key (and the nearest known one), missing key,
///         wrong type, value out of range
Scene read_scene(const std::filesystem::path& path, std::span<const std::string> overrides = {});

/// The same without its fingerprint, which takes reading every file that the scene names.
Scene read_scene_alone(const std::filesystem::path& path, std::span<const std::string> overrides = {});

/// The text of a scene file, unread. @throws InputError for what is no text of a scene: a volume, a picture, a folder
std::string read_scene_text(const std::filesystem::path& path);

/// The same of a scene's text; relative paths start at the folder of `path`, which names it in errors.
/// @param arrays  what stands in no file
Scene parse_scene(const std::string& text, const std::filesystem::path& path,
                  std::span<const std::string> overrides = {}, const SceneArrays& arrays = {});

/// The same without its fingerprint.
Scene parse_scene_alone(const std::string& text, const std::filesystem::path& path,
                        std::span<const std::string> overrides = {}, const SceneArrays& arrays = {});

}  // namespace brume
