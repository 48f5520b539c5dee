#include "evaluate/tuning.h"

#include <algorithm>
#include <cmath>

#include "base/parallel_for.h"

namespace brume {

std::vector<FilterSettings> search_grid(const FilterEntry& filter) {
  std::vector<FilterSettings> grid = {FilterSettings(filter)};
  for (const Parameter& p : filter.parameters) {
    if (p.candidates.empty()) continue;
    std::vector<FilterSettings> wider;
    for (const FilterSettings& settings : grid)
      for (const Parameter::Value& value : p.candidates) {
        wider.push_back(settings);
        wider.back().set(p, value);
      }
    grid = std::move(wider);
  }
  return grid;
}

std::vector<double> search(const std::vector<FilterSettings>& grid, const Layers& frame, const ApplyOptions& options,
                           const LabRms& metric, const Task& task) {
  std::vector<double> squared(grid.size());
  parallel_for(static_cast<int>(grid.size()), task, [&](int i) {
    const Layers clean = apply_filter(grid[static_cast<size_t>(i)], frame, options, {1, {}, task.cancel});
    squared[static_cast<size_t>(i)] = metric.squared(clean.rgb(layer::beauty));
  });
  return squared;
}

size_t best_setting(const std::vector<const std::vector<double>*>& searches) {
  size_t best = 0;
  double lowest = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < searches[0]->size(); ++i) {
    double sum = 0;
    for (const std::vector<double>* s : searches) sum += std::log(std::max((*s)[i], 1e-12));
    if (sum < lowest) lowest = sum, best = i;
  }
  return best;
}

}  // namespace brume
