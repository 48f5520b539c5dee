#pragma once
#include <optional>

#include "render/transport/integrator.h"

namespace brume {

/// Distance along a camera ray [scene units] to where half of what it sees of the media lies, or to a surface in front
/// of that; nothing where it meets neither.
std::optional<double> seen_depth(const PathContext& context, const Ray& ray);

}  // namespace brume
