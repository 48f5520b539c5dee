#pragma once
#include <set>
#include <utility>

#include "image/plane.h"

namespace brume {

/// The plane with its pixels that are not finite replaced by the median of their finite neighbours, from the rims of
/// holes inward; a plane without any finite pixel becomes 0.
/// @param bad  is given those pixels
Plane without_holes(const Plane& plane, std::set<std::pair<int, int>>& bad);

}  // namespace brume
