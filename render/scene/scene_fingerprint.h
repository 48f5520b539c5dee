#pragma once
#include "render/scene/scene.h"

namespace brume {

/// Fills in Scene::hash and Scene::settings from everything that decides the picture; files count by their contents.
/// Sample count, seed and frame are left out: the parts of one render share a hash.
void add_fingerprint(Scene& scene);

}  // namespace brume
