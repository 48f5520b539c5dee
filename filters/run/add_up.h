#pragma once
#include <array>
#include <span>
#include <vector>

#include "filters/inputs/planes.h"

namespace brume {

/// Changes estimates so that they add up to their known sum: each takes a share of the difference as its error is of
/// all errors, so that what is well known changes little, and none falls below 0 where the sum is not. That is the most
/// likely correction where the sum is exact and errors are independent and normal.
/// @param values  the largest becomes the float nearest to what the others leave
/// @param errors  squared, or what counts as such; above 0
/// Source: reconciliation of forecasts, Wickramasuriya, Athanasopoulos, Hyndman 2019, with a diagonal covariance.
void add_up_exactly(std::span<float> values, std::span<const double> errors, double sum);

/// The same for pictures. @param errors  root mean squares of each picture, or none: bright ones err more
void add_up_exactly(const std::vector<std::array<Plane*, 3>>& parts, const std::vector<Plane>& errors,
                    const RgbPlanes& sum, const Task& task);

}  // namespace brume
