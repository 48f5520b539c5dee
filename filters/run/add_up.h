#pragma once
#include <array>
#include <span>
#include <vector>

#include "filters/inputs/planes.h"

namespace brume {

/// Changes estimates so that they add up to their known sum: each takes a share of the difference, and none falls below
/// 0 where the sum is not.
/// @param values   the largest becomes the float nearest to what the others leave
/// @param weights  the shares, relative to one another; above 0
void add_up_exactly(std::span<float> values, std::span<const double> weights, double sum);

/// The same for pictures. Shares are a part's light times its error: squared errors would be the likeliest correction,
/// but errors are estimated over many pixels, and what dark pixels of a bright part were given by them is seen.
/// @param errors  root mean squares of each picture, or none
void add_up_exactly(const std::vector<std::array<Plane*, 3>>& parts, const std::vector<Plane>& errors,
                    const RgbPlanes& sum, const Task& task);

}  // namespace brume
