#pragma once
#include <string>

namespace brume {

/// docs/scene.md: every table and key, from the declarations that parse them.
std::string scene_reference();

}  // namespace brume
