#pragma once
#include <functional>
#include <span>

#include "volume/instances.h"

// Ways through the tree over instances, for the best instruction set of the machine.

namespace brume {

/// A ray from where it comes into the box of all nodes.
struct SearchRay {
  dvec3 o, d;
  double size;  ///< largest coordinate of that box
};

/// Takes a ray to the boxes of instances that it meets before `limit`, the nearest nodes first. Single precision may
/// add a few boxes that it misses.
/// @param visit  gets a place in the order of instances, and returns a new limit
void search_instances(std::span<const InstanceNode> nodes, const SearchRay& ray, float limit,
                      const std::function<float(size_t)>& visit);
/// The same for the boxes that overlap another one.
void search_instances(std::span<const InstanceNode> nodes, const vec3& lo, const vec3& hi,
                      const std::function<void(size_t)>& visit);

}  // namespace brume
