#pragma once
#include <string>

#include "evaluate/protocol.h"

namespace brume {

/// Speed against error as SVG: Lab RMS of the whole frame over render + filter seconds, log-log, plain path tracing and
/// every filter at every spp. Solid: searched parameters (or paper's where none were searched); dotted: the
/// paper's.
std::string error_seconds_plot(const SceneResult& scene);

}  // namespace brume
