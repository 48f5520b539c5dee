#pragma once
#include <functional>
#include <span>

#include "volume/instances.h"

// Ways through the tree over instances, for the best instruction set of the machine.

namespace brume {

/// Takes a ray to the boxes of instances that it meets before `limit`. Single precision may add a few boxes that it
/// misses.
/// @param visit  gets a place in the order of instances
void search_instances(std::span<const InstanceNode> nodes, const SearchRay& ray, float limit,
                      const std::function<void(size_t)>& visit);
/// The first of these boxes after another one, in order, and whose they are.
/// @return how many; fewer than there is room for where there are no more
size_t nearest_instances(std::span<const InstanceNode> nodes, std::span<const uint32_t> order, const SearchRay& ray,
                         float limit, const Instances::Met& after, std::span<Instances::Met> found);
/// The same for the boxes that overlap another one.
void search_instances(std::span<const InstanceNode> nodes, const vec3& lo, const vec3& hi,
                      const std::function<void(size_t)>& visit);

}  // namespace brume
