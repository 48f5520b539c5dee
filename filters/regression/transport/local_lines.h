#pragma once
#include <vector>

#include "filters/inputs/half_pair.h"

namespace brume {

/// Lines in position and features around every pixel, weighted by non-local means, each half with the weights of the
/// other, whose noise is independent: for what no guide explains over wider windows. Source: Bitterli et al. 2016,
/// Nonlinearly Weighted First-order Regression, section 4.
/// @param features  free of noise, at most 1
/// @param wanted    above 0 where lines are asked for; elsewhere the data are returned
HalfPair local_lines(const HalfPair& data, const std::vector<const Plane*>& features, const Plane& wanted,
                     const Task& task);

}  // namespace brume
