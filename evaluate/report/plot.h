#pragma once
#include <string>

#include "evaluate/protocol/results.h"

namespace brume {

/// Speed against error as SVG: Lab RMS of the whole frame over render + guides + filter seconds, log-log, plain path
/// tracing and every filter at every spp. Solid: searched parameters, or the defaults where none were searched; dotted:
/// the defaults beside searched ones.
/// @param origin  what it was made with, by name: goes into its description
std::string error_seconds_plot(const SceneResult& scene,
                               const std::vector<std::pair<std::string, std::string>>& origin);

}  // namespace brume
