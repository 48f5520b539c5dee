#pragma once
#include "filters/inputs/filter_frame.h"

namespace brume {

/// Unit directions of a layer of mean directions, x, y, z, and a fourth plane that is 1 where they are defined, else 0.
std::vector<Plane> unit_directions(const RgbPlanes& mean, const Task& task);

/// The same of the feature `gradient`: the transmittance-weighted density gradient where the frame has it, otherwise
/// the one at the medium's surface. Empty when it was not chosen as a feature.
std::vector<Plane> unit_directions(const FilterFrame& frame, const Task& task);

}  // namespace brume
