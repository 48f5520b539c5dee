#pragma once
#include <cstdint>
#include <filesystem>
#include <set>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "render/scene/scene_fields.h"

namespace brume {

/// A key of a scene's table with the value that holds: what its text says, or the default.
struct SceneKey {
  enum class Type { kSwitch, kInteger, kNumber, kText, kChoice, kFile, kVector, kColour, kNumbers, kTable };
  using Value = std::variant<bool, int64_t, double, std::string, std::vector<double>>;

  Field field;
  Type type;
  Value value;
  friend bool operator==(const SceneKey& a, const SceneKey& b) {
    return a.field.key == b.field.key && a.value == b.value;
  }
};

struct SceneTable {
  std::string path;  ///< as in assignments: "camera", "volumes.0"
  std::vector<SceneKey> keys;
  const SceneKey* find(std::string_view key) const;
  friend bool operator==(const SceneTable&, const SceneTable&) = default;
};

/// What a scene says, key by key, disabled entries included: for programs that let people edit it. Values are the
/// text's own, not yet combined with one another as read_scene does. Tables of numbers are written as text.
/// @param arrays  the volumes and meshes that stand in no file
/// @throws InputError as read_scene, but for what only its checks find
std::vector<SceneTable> outline_scene(const std::string& text, const std::filesystem::path& path,
                                      std::span<const std::string> assignments = {}, const SceneArrays& arrays = {});

/// What assignments set in a scene of one volume and one light, key by key: "camera.fov", "volumes.0.grid".
/// @throws InputError for what is no assignment
std::set<std::string> assigned_keys(std::span<const std::string> assignments);

/// The text of a scene after assignments, comments and order kept; relative names of files become absolute, so that it
/// may be put anywhere. @throws InputError as outline_scene
std::string edited_scene(const std::string& text, const std::filesystem::path& path,
                         std::span<const std::string> assignments, const SceneArrays& arrays = {});

/// The same for a file beside the one that `text` names its files from: those stay as they are, and relative names that
/// the assignments bring, which start at the folder of `from`, become absolute.
/// @param path  in the folder of the new file
std::string moved_scene(const std::string& text, const std::filesystem::path& path,
                        std::span<const std::string> assignments, const std::filesystem::path& from);

}  // namespace brume
