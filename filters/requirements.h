#pragma once
#include <set>

#include "filters/apply.h"

namespace brume {

/// Names of the layers in a frame, without their statistics: "beauty" for R G B on top.
std::vector<std::string> layer_names(const Layers& frame);

/// What a run cleans, one after another.
std::vector<LayerName> signals_of(const ApplyOptions& options);

/// The layers without which a run is impossible: the component's, the filter's.
std::vector<LayerName> required_layers(const FilterEntry& filter, const ApplyOptions& options);

/// The full names of all channels that a run reads where a frame has them: statistics and features included.
std::set<std::string> readable_channels(const FilterSettings& filter, const ApplyOptions& options);

/// @throws InputError when the frame, or another of the sequence, lacks a layer or statistic: names all of them, and
///                    the command that records them; when the options do not go together
void check_requirements(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options);

}  // namespace brume
