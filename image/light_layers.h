#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "image/layers.h"

namespace brume {

// Layers of light groups: `light.NAME`, and `light.NAME.direct`, `light.NAME.indirect`.

inline constexpr std::string_view kLightPrefix = "light.";

/// The layer of a group's light.
inline std::string light_layer(std::string_view group) {
  return std::string(kLightPrefix) + std::string(group);
}

/// The word that asks for aimed_light_layer() of each group, where there are any.
inline constexpr std::string_view kLightAimed = "light_aimed";

/// A group's light with less noise, from which it is cleaned: these do not add up to the picture.
inline std::string aimed_light_layer(std::string_view group) {
  return light_layer(group) + ".aimed";
}
inline bool is_aimed_light(std::string_view channel) {
  return channel.starts_with(kLightPrefix) && channel.find(".aimed.") != std::string_view::npos;
}

/// The same, clean: all of them add up to the clean picture.
inline std::string clean_light_layer(std::string_view group) {
  return "clean_" + light_layer(group);
}

/// What guides predict of it. @param part  direct or indirect
inline std::string predicted_light_layer(std::string_view group, std::string_view part) {
  return light_layer(group) + ".predicted_" + std::string(part);
}
inline bool is_predicted_light(std::string_view channel) {
  return channel.starts_with(kLightPrefix) && channel.find(".predicted_") != std::string_view::npos;
}

/// Whether a guide's channel may say anything about a group's light: it is of none, or of this one, as
/// "guide.single.key-sun.Y" is of "key".
inline bool may_guide_light(std::string_view channel, std::string_view group) {
  const size_t end = channel.rfind('-');
  if (end == std::string_view::npos) return true;
  const size_t begin = channel.rfind('.', end) + 1;
  return channel.substr(begin, end - begin) == group;
}

/// Names of the groups whose light a frame has, sorted.
inline std::vector<std::string> light_groups_in(const Layers& frame) {
  std::vector<std::string> groups;
  for (const auto& [name, plane] : frame.channels()) {
    if (!name.starts_with(kLightPrefix) || !name.ends_with(".R")) continue;
    const std::string group = name.substr(kLightPrefix.size(), name.size() - kLightPrefix.size() - 2);
    if (group.find('.') == std::string::npos) groups.push_back(group);
  }
  return groups;
}

}  // namespace brume
