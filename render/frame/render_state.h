#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume {

/// Throws InputError, naming both sides and what differs, unless two frames are parts of one render: the same scene,
/// seed, frame, crop, layers, statistics and program.
/// @param same_samples  and they also begin at the same sample
void check_same_render(const Layers& a, const std::string& name_a, const Layers& b, const std::string& name_b,
                       bool same_samples);

/// The layers a frame's header says were recorded, for a film that takes its sums.
struct LayerRequest recorded_in(const Layers& frame);

/// Merges parts of one render, written with keep_state or as checkpoints: the same bits as one render of all their
/// samples.
/// @param keep_state  the result can be merged or resumed again
/// @throws InputError: other scenes, seeds, crops, layers or program versions (says which), overlapping samples, no
/// state
Layers merge_parts(const std::vector<std::filesystem::path>& files, bool keep_state);

}  // namespace brume
