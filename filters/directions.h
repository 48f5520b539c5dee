#pragma once
#include "filters/planes.h"

namespace brume {

/// Unit directions of the density gradient, x, y, z, and a fourth plane that is 1 where they are defined, else 0: of the
/// transmittance-weighted gradient where the frame has it, otherwise of the one at the medium's surface. Empty when it
/// has neither.
std::vector<Plane> unit_directions(const Layers& layers, const Task& task);

/// The same of one layer of directions.
std::vector<Plane> unit_directions(const RgbPlanes& mean, const Task& task);

}  // namespace brume
