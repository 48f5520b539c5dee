#pragma once
#include "filters/run/apply.h"

namespace brume {

/// Cleans the parts of the light that a frame records beside direct and indirect, and the transmittance: background,
/// emission, single, surface, surface_emission, volume_indirect, surface_indirect, transmittance and the shadow
/// catchers' layers become clean_background and so on. Each is cleaned by itself. Where all parts of a whole are there,
/// they are scaled alike so that they add up to clean_direct and clean_indirect (to the picture on top, where the
/// filter makes no such parts), but for rounding.
/// @param frame  raw parts with their statistics, and the clean picture (Cleaner::clean); the clean parts are added
void clean_parts(const FilterSettings& filter, const ApplyOptions& options, Layers& frame, const Task& task);

/// The layer of a clean part: "clean_single".
std::string clean_part_name(const LayerName& part);

}  // namespace brume
