#pragma once
#include <set>

#include "filters/api/filter.h"
#include "filters/api/options.h"

namespace brume {

/// Header entry of a frame by another renderer, with its name: errors then say what its user can do.
inline constexpr const char* kForeignRenderer = "brume.foreignRenderer";

/// What to do about something that a frame lacks: `recording`, or of another renderer's frame, which brume cannot
/// record, another filter.
/// @param other  what else its user can do, followed by the filter: "say ..., or "
std::string way_to(const std::string& recording, const Layers& frame, const std::string& other = "");

/// Names of the layers in a frame, without their statistics: "beauty" for R G B on top.
std::vector<std::string> layer_names(const Layers& frame);

/// The options as a filter uses them: the beauty of a frame that knows its parts is cleaned in parts by filters that do
/// so.
ApplyOptions options_for(const FilterEntry& filter, const Layers& frame, const ApplyOptions& wanted);

/// Whether outliers are limited by the signal's variance.
bool limits_outliers(const ApplyOptions& options);

/// What a run cleans, one after another.
std::vector<LayerName> signals_of(const ApplyOptions& options);

/// The layers without which a run is impossible: the component's, the filter's.
std::vector<LayerName> required_layers(const FilterEntry& filter, const ApplyOptions& options);

/// The full names of all channels that a run reads where a frame has them: statistics, features and guides included.
/// @param frame  its layers count, not its pixels
std::set<std::string> readable_channels(const FilterSettings& filter, const ApplyOptions& options, const Layers& frame);

/// @throws InputError when the frame, or another of the sequence, lacks a layer or statistic: names all of them, and
///                    the command that records them; when the options do not go together
void check_requirements(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options);

}  // namespace brume
