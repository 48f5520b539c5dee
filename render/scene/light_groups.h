#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "render/scene/scene.h"

namespace brume {

/// Which light group each thing that shines is of. Its light has layers of its own: `light.NAME`.
struct LightGroups {
  std::vector<std::string> names;  ///< in the scene's order, then "rest" where something has no name; empty: no groups
  size_t environment = 0;          ///< all of them: places in `names`
  std::vector<size_t> volumes, lights, surfaces;
};

/// By the keys `group`; with render.light_groups what has none is a group by itself, named after its kind.
LightGroups light_groups_of(const Scene& scene);

/// What forbids a name, to be said after it; empty: nothing.
std::string what_forbids_group(std::string_view name);

}  // namespace brume
