#pragma once
#include "evaluate/metric.h"
#include "filters/apply.h"

namespace brume {

/// Every combination of a filter's candidate values, the rest at their defaults, in a fixed order.
std::vector<FilterSettings> search_grid(const FilterEntry& filter);

/// The squared Lab error of each setting on one frame, in the grid's order. Settings run in parallel, each on one
/// thread.
std::vector<double> search(const std::vector<FilterSettings>& grid, const Layers& frame, const ApplyOptions& options,
                           const LabRms& metric, const Task& task);

/// Index of the smallest geometric mean over several searches of one grid: the setting that is best for all of them.
size_t best_setting(const std::vector<const std::vector<double>*>& searches);

}  // namespace brume
