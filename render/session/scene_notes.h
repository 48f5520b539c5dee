#pragma once
#include <string>
#include <vector>

#include "render/transport/plan.h"

namespace brume {

/// What a user may not expect of a scene: light that cannot arrive, motion without a shutter, catchers whose layers are
/// not recorded.
std::vector<std::string> scene_notes(const Scene& scene, const SceneMedia& media, const Lights& lights,
                                     const LayerRequest& layers);

}  // namespace brume
