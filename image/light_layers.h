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
