#include "evaluate/tuning.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/parallel_for.h"
#include "filters/registry.h"

namespace brume {

constexpr int kSharedScratch = 200;  // floats per pixel

Contender parse_contender(const std::string& text) {
  Contender contender{parse_filter(text), {}, ""};
  const FilterEntry& filter = contender.settings.entry();
  contender.label = filter.name;
  if (text == filter.name) contender.paper = parse_filter(filter.name + ":preset=paper");
  if (const size_t colon = text.find(':'); colon != std::string::npos)
    for (const auto& [name, value] : parse_assignments(text.substr(colon + 1))) {
      contender.label +=
          name == "preset" || !filter.find(name)->choices.empty() ? " " + value : fmt::format(" {}={}", name, value);
      if (name == "preset")
        for (const auto& assignment : filter.find_preset(value).settings) contender.fixed.push_back(assignment.first);
      else
        contender.fixed.push_back(name);
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

std::vector<FilterSettings> with_each_candidate(const FilterSettings& settings, const Parameter& p) {
  std::vector<FilterSettings> list;
  for (const Parameter::Value& value : p.candidates) {
    list.push_back(settings);
    list.back().set(p, value);
  }
  return list;
}

/// Filter and parameters: what a setting is known by.
std::string key(const FilterSettings& settings) {
  return settings.entry().name + " " + settings.text();
}

constexpr int kMostRounds = 4;

}  // namespace

std::vector<std::string> on_the_edge(const Contender& contender, const FilterSettings& found) {
  std::vector<std::string> names;
  for (const Parameter& p : contender.settings.entry().parameters)
    if (is_searched(contender, p) && p.choices.empty() &&
        (found.get(p) == p.candidates.front() || found.get(p) == p.candidates.back()))
      names.push_back(p.name);
  return names;
}

std::vector<FilterSettings> candidate_settings(const Contender& contender) {
  std::vector<FilterSettings> list = {contender.settings};
  if (contender.paper) list.push_back(*contender.paper);
  for (const Parameter& p : contender.settings.entry().parameters)
    if (is_searched(contender, p))
      for (FilterSettings& settings : with_each_candidate(contender.settings, p)) list.push_back(std::move(settings));
  return list;
}

double TuningFrame::measure(const FilterSettings& settings, const Task& task) const {
  ApplyOptions with = options_;
  std::optional<RecordReader> reader;
  if (!records_.empty()) with.records = &reader.emplace(records_);
  return metric_.squared(apply_filter(settings, *frame_, with, task).rgb(layer::beauty));
}

std::vector<double> TuningFrame::squared_errors(const std::vector<FilterSettings>& settings, const Task& task) {
  std::vector<const FilterSettings*> fresh;
  for (const FilterSettings& s : settings)
    if (known_.try_emplace(key(s), -1.0).second) fresh.push_back(&s);
  std::vector<double> measured(fresh.size());
  // Filters that hold much at a time would hold it once for each thread.
  if (!fresh.empty() && fresh[0]->entry().scratch > kSharedScratch)
    for (size_t i = 0; i < fresh.size(); ++i) measured[i] = measure(*fresh[i], quiet(task));
  else
    parallel_for(static_cast<int>(fresh.size()), quiet(task), [&](int i) {
      const auto at = static_cast<size_t>(i);
      measured[at] = measure(*fresh[at], {1, {}, task.cancel});
    });
  for (size_t i = 0; i < fresh.size(); ++i) known_[key(*fresh[i])] = measured[i];
  std::vector<double> errors;
  for (const FilterSettings& s : settings) errors.push_back(known_.at(key(s)));
  return errors;
}

FilterSettings search(const Contender& contender, std::vector<TuningFrame*> frames, const Task& task) {
  const auto sum_of_logs = [&](const std::vector<FilterSettings>& settings) {
    std::vector<double> sums(settings.size());
    for (TuningFrame* frame : frames) {
      const std::vector<double> errors = frame->squared_errors(settings, task);
      for (size_t i = 0; i < sums.size(); ++i) sums[i] += std::log(std::max(errors[i], 1e-12));
    }
    return sums;
  };
  FilterSettings best = contender.settings;
  double lowest = sum_of_logs({best})[0];
  const auto take_better = [&](const std::vector<FilterSettings>& settings) {
    const std::vector<double> sums = sum_of_logs(settings);
    const size_t i = static_cast<size_t>(std::min_element(sums.begin(), sums.end()) - sums.begin());
    if (!(sums[i] < lowest)) return false;
    lowest = sums[i];
    best = settings[i];
    return true;
  };
  if (contender.paper) take_better({*contender.paper});
  for (int round = 0; round < kMostRounds; ++round) {
    bool changed = false;
    for (const Parameter& p : contender.settings.entry().parameters)
      if (is_searched(contender, p)) changed |= take_better(with_each_candidate(best, p));
    task.report((round + 1.0) / kMostRounds);
    if (!changed) break;
  }
  task.report(1);
  return best;
}

}  // namespace brume
