#pragma once
#include "filters/run/apply.h"

namespace brume {

/// Cleans the light groups of a frame, light.NAME, whose picture is clean already: each by itself, by the guides that
/// know of its light; then they are made to add up to the picture (filters/run/add_up). docs/passes.md has the reasons.
/// @param raw    with groups and guides; may be the same frame
/// @param clean  with the clean picture on top; gets clean_light.NAME
void clean_lights(const FilterSettings& filter, const ApplyOptions& options, const Layers& raw, Layers& clean,
                  const Task& task);

}  // namespace brume
