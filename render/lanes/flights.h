#pragma once
#include <cstdint>

#include "render/lanes/lane_scene.h"
#include "render/lanes/path_states.h"

// Flights and shadow rays of many paths side by side, for the best instruction set of the machine.

namespace brume {

/// Flies the rays of a list to their next real collision, whose position becomes the path's, or out of the grid, or to
/// their reach.
void lanes_fly(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
               uint64_t& lookups);

/// Leaves the transmittance along each shadow ray, as far as its reach, in `transmittance`, by ratio tracking.
void lanes_shadow(const LaneScene& scene, PathStates& paths, const SlotList& rays, uint64_t& lookups);

/// Forced first collisions: flies the camera rays through the whole grid or to their reach, leaves their transmittance
/// in `passed`, and scatters the rest of each at one of its tentative collisions, its throughput being the share that
/// is scattered. Rays with nothing to scatter escape.
///
/// Where the medium is thin, most flights would pass it: here each of them brings its light.
/// Source: our combination of ratio tracking with reservoir sampling of the tentative collisions; the aim is that of
/// Villemin, Wrenninge, Fong 2018, Efficient Unbiased Rendering of Thin Participating Media.
void lanes_fly_first(const LaneScene& scene, PathStates& paths, const SlotList& rays, SlotList& hits, SlotList& escapes,
                     uint64_t& lookups);

}  // namespace brume
