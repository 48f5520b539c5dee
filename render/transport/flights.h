#pragma once
#include <cstdint>

#include "render/transport/lane_scene.h"
#include "render/transport/path_states.h"

// Flights and shadow rays of many paths side by side, for the best instruction set of the machine.

namespace brume {

/// Delta tracking: takes each ray of a list to its next real collision, whose position becomes the flight's origin, or
/// out of the grid, or to its end on a light. Where LaneScene::flights_end, PathStates::travel is the collision's ray
/// parameter. In a chromatic medium the hero channel decides, and `flight_factor` is each channel's probability of what
/// happened.
void lanes_fly(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
               uint64_t& lookups);

/// Ratio tracking: multiplies `transmittance` by an estimate of each shadow ray's up to its light;
/// in a chromatic medium `shadow_colour`.
void lanes_shadow(const LaneScene& scene, PathStates& paths, const SlotList& rays, uint64_t& lookups);

/// Forced first collisions: camera rays cross the whole grid, or end on a light. Their transmittance by ratio tracking
/// is stored in `camera_transmittance`. Each tentative collision scatters its share of what is left; one of them, drawn
/// in proportion to these amounts, becomes the path's vertex, with their sum as throughput. Rays that scatter nothing
/// escape.
///
/// In a thin medium most free flights would pass without a collision; forced, every camera ray scatters light.
/// Source: our combination of ratio tracking with reservoir sampling of the tentative collisions; the aim is that of
/// Villemin, Wrenninge, Fong 2018, Efficient Unbiased Rendering of Thin Participating Media.
void lanes_fly_first(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
                     uint64_t& lookups);

}  // namespace brume
