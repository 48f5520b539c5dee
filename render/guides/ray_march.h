#pragma once
#include "render/guides/march_scene.h"

namespace brume {

/// Marches rays through the media to their ends, a vector of them side by side, in single precision. What is found of a
/// ray depends neither on the others nor on the instruction set.
void march_rays(const MarchScene& scene, const MarchedFields& fields, MarchBatch& batch);

}  // namespace brume
