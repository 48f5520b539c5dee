#pragma once
#include <cstdint>

#include "render/transport/lane_scene.h"
#include "render/transport/path_states.h"

namespace brume {

/// The event at the end of a flight: absorption, a sample of one light, roulette, a new direction.
/// @param shadows  those whose light sample is worth a shadow ray   @param alive  those that go on
void lanes_scatter(const LaneScene& scene, PathStates& paths, SlotList& slots, SlotList& shadows, SlotList& alive,
                   uint64_t& capped_paths, double& capped_throughput);

}  // namespace brume
