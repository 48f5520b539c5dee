#pragma once
#include <string>

#include "image/layers.h"

namespace brume {

/// Throws InputError, naming both sides and what differs, unless two frames are parts of one render: the same scene,
/// seed, frame, crop, layers, statistics and program.
/// @param same_samples  and they also begin at the same sample
void check_same_render(const Layers& a, const std::string& name_a, const Layers& b, const std::string& name_b,
                       bool same_samples);

/// The layers a frame's header says were recorded, for a film that takes its sums.
struct LayerRequest recorded_in(const Layers& frame);

}  // namespace brume
