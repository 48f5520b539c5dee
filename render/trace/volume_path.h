#pragma once
#include "render/trace/integrator.h"

namespace brume {

/// The general path loop: any number of media, chromatic or moving, meshes, near lights. The instantiation that models
/// what the plan needs and nothing else.
TracePaths select_general_loop(const Plan& plan);

}  // namespace brume
