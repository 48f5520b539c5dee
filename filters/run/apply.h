#pragma once
#include "filters/api/filter.h"
#include "filters/api/options.h"

namespace brume {

struct ApplyReport {
  double seconds = 0;             ///< of the filter, conversions included
  size_t repaired_pixels = 0;     ///< not finite in a layer that was read
  size_t extreme_pixels = 0;      ///< of the frame to clean, limited or kept (filters/inputs/extremes.h)
  size_t repaired_records = 0;    ///< pixels with recorded samples that were not finite
  size_t not_finite_results = 0;  ///< pixels the filter could not finish; they kept their input
  size_t tiles = 1;
  std::vector<std::string> notes;
};

/// Cleans a frame. The result holds R G B, A where the frame has it, the carried layers, and the header with the filter
/// and every parameter. Non-finite pixels are replaced by the median of their finite neighbours before the filter, from
/// the rim of a hole inward, and counted. Frames that need more room than a quarter of the layers read are filtered
/// tile by tile.
/// @throws InputError when a needed layer or statistic is missing: names all of them, and the command that records
/// them;
///                    for another frame of the sequence too; when a signal has no finite pixel; when the machine has
///                    not the memory
Layers apply_filter(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options, const Task& task,
                    ApplyReport* report = nullptr);

}  // namespace brume
