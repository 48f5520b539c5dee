#pragma once
#include <cstddef>
#include <span>

#include "render/transport/camera_layers.h"

namespace brume {

/// The rays of one pixel in a list, close enough to each other to be marched as a packet: see LaneGrid::Entry.
struct RayPacket {
  size_t begin, end;
  int axis, layer;
};

/// lanes_find_isosurface for packets, in steps of half a layer of voxels. The result of a ray does not depend on the
/// other rays of its packet.
void lanes_find_isosurface(const LaneScene& scene, const PathStates& paths, const SlotList& rays,
                           std::span<const RayPacket> packets, IsosurfaceCrossings& crossings);

}  // namespace brume
