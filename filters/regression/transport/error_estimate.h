#pragma once
#include <vector>

#include "filters/regression/transport/mixing.h"

namespace brume {

/// Squared error at each pixel, mean over colours: the noise that the halves' difference shows, and the bias that both
/// halves miss of their own data as far as it is beyond that estimate's standard error.
/// @param regions  what is averaged in one says nothing about another
Plane squared_error(const HalfPair& result, const HalfPair& data, const std::vector<MixingRegion>& regions,
                    const Task& task);

}  // namespace brume
