#include "evaluate/tuning.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/parallel_for.h"
#include "base/text.h"
#include "filters/registry.h"

namespace brume {

constexpr int kSharedScratch = 200;  // floats per pixel

Contender parse_contender(const std::string& text) {
  Contender contender{parse_filter(text), {}, ""};
  const FilterEntry& filter = contender.settings.entry();
  contender.label = filter.name;
  if (const size_t colon = text.find(':'); colon != std::string::npos)
    for (const std::string& assignment : split(text.substr(colon + 1), ',')) {
      const std::string name = assignment.substr(0, assignment.find('='));
      contender.fixed.push_back(name);
      contender.label += " " + (filter.find(name)->choices.empty() ? assignment : assignment.substr(name.size() + 1));
    }
  return contender;
}

std::vector<Contender> all_contenders() {
  std::vector<Contender> contenders;
  for (const FilterEntry* filter : all_filters()) {
    if (filter->records == FilterEntry::Records::kNeeds) continue;  // gigabytes a frame: only when asked for
    contenders.push_back(parse_contender(filter->name));
    for (const std::string& setting : filter->also_compare)
      contenders.push_back(parse_contender(filter->name + ":" + setting));
  }
  return contenders;
}

namespace {

bool is_searched(const Contender& contender, const Parameter& p) {
  return !p.candidates.empty() &&
         std::find(contender.fixed.begin(), contender.fixed.end(), p.name) == contender.fixed.end();
}

}  // namespace

std::vector<std::string> on_the_edge(const Contender& contender, const FilterSettings& found) {
  std::vector<std::string> names;
  for (const Parameter& p : contender.settings.entry().parameters)
    if (is_searched(contender, p) && p.choices.empty() &&
        (found.get(p) == p.candidates.front() || found.get(p) == p.candidates.back()))
      names.push_back(p.name);
  return names;
}

std::vector<FilterSettings> search_grid(const Contender& contender) {
  std::vector<FilterSettings> grid = {contender.settings};
  for (const Parameter& p : contender.settings.entry().parameters) {
    if (!is_searched(contender, p)) continue;
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

std::vector<double> search(const std::vector<FilterSettings>& grid, const Layers& frame,
                           const std::filesystem::path& records, const ApplyOptions& options, const LabRms& metric,
                           const Task& task) {
  std::vector<double> squared(grid.size());
  const auto measure = [&](size_t i, const Task& own) {
    ApplyOptions with = options;
    std::optional<RecordReader> reader;
    if (!records.empty()) with.records = &reader.emplace(records);
    squared[i] = metric.squared(apply_filter(grid[i], frame, with, own).rgb(layer::beauty));
  };
  // Filters that hold much at a time would hold it once for each thread.
  if (!grid.empty() && grid[0].entry().scratch > kSharedScratch) {
    for (size_t i = 0; i < grid.size(); ++i) {
      measure(i, quiet(task));
      task.report(static_cast<double>(i + 1) / static_cast<double>(grid.size()));
    }
    return squared;
  }
  parallel_for(static_cast<int>(grid.size()), task, [&](int i) {
    measure(static_cast<size_t>(i), {1, {}, task.cancel});
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
