#pragma once
#include <filesystem>

#include "evaluate/metric.h"
#include "filters/apply.h"

namespace brume {

/// One line of a comparison: a filter, and the parameters that make it this line rather than another of the same
/// filter.
struct Contender {
  FilterSettings settings;
  std::vector<std::string> fixed;  ///< parameters that the search leaves alone
  std::string label;               ///< "gradient_kernel", "gradient_kernel mul"
};

/// "NAME" or "NAME:parameter=value,...". @throws InputError
Contender parse_contender(const std::string& text);
/// Every filter at its defaults that needs no records, and what its declaration also compares.
std::vector<Contender> all_contenders();

/// Every combination of a contender's candidate values, the rest as it has them, in a fixed order.
std::vector<FilterSettings> search_grid(const Contender& contender);

/// The parameters of a search's result that lie on the edge of their candidates: there the optimum may be further out.
std::vector<std::string> on_the_edge(const Contender& contender, const FilterSettings& found);

/// The squared Lab error of each setting on one frame, in the grid's order. Settings run in parallel, each on one
/// thread; filters that take long by themselves one after another on all of them.
std::vector<double> search(const std::vector<FilterSettings>& grid, const Layers& frame,
                           const std::filesystem::path& records, const ApplyOptions& options, const LabRms& metric,
                           const Task& task);

/// Index of the smallest geometric mean over several searches of one grid: the setting that is best for all of them.
size_t best_setting(const std::vector<const std::vector<double>*>& searches);

}  // namespace brume
