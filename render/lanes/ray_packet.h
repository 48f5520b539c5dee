#pragma once
#include <cstddef>
#include <span>

#include "render/lanes/camera_layers.h"

namespace brume {

/// The rays of one pixel in a list, so close to each other that they are walked together: see LaneGrid::Entry.
struct RayPacket {
  size_t begin, end;
  int axis, layer;
};

/// lanes_find_surface for packets, half a layer of voxels at a time. What is found of a ray does not depend on the
/// others in its packet.
void lanes_find_surface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                        std::span<const RayPacket> packets, SurfaceCrossings& crossings);

}  // namespace brume
