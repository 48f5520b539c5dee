#include "evaluate/protocol/tuning.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/parallel_for.h"
#include "base/rng.h"
#include "base/text.h"
#include "evaluate/protocol/result_store.h"
#include "filters/api/registry.h"

namespace brume {

constexpr int kSharedScratch = 200;  // floats per pixel

Contender parse_contender(const std::string& text) {
  Contender contender{parse_filter(text), {}, ""};
  const FilterEntry& filter = contender.settings.entry();
  contender.label = filter.name;
  const bool is_published = std::any_of(filter.presets.begin(), filter.presets.end(),
                                        [](const Preset& preset) { return preset.name == "paper"; });
  if (text == filter.name && is_published) contender.paper = parse_filter(filter.name + ":preset=paper");
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

std::vector<FilterSettings> with_each_candidate(const FilterSettings& settings, const Parameter& p) {
  std::vector<FilterSettings> list;
  for (const Parameter::Value& value : p.candidates) {
    list.push_back(settings);
    list.back().set(p, value);
  }
  return list;
}

constexpr int kMostRounds = 4;
constexpr size_t kExhaustive = 48;  // combinations that are all tried

}  // namespace

std::vector<std::string> on_the_edge(const Contender& contender, const FilterSettings& found) {
  std::vector<std::string> names;
  for (const Parameter& p : contender.settings.entry().parameters)
    if (contender.searches(p) && p.choices.empty() &&
        (found.get(p) == p.candidates.front() || found.get(p) == p.candidates.back()))
      names.push_back(p.name);
  return names;
}

std::vector<FilterSettings> candidate_settings(const Contender& contender) {
  std::vector<FilterSettings> list = {contender.settings};
  if (contender.paper) list.push_back(*contender.paper);
  for (const Parameter& p : contender.settings.entry().parameters)
    if (contender.searches(p))
      for (FilterSettings& settings : with_each_candidate(contender.settings, p)) list.push_back(std::move(settings));
  return list;
}

double TuningFrame::measure(const Contender& contender, const FilterSettings& settings, const Task& task) const {
  ApplyOptions with = options_;
  with.features = contender.features;
  std::optional<Layers> part;
  if (!contender.guides) part = without_layers(frame_, {guide_root()});
  const Layers* frame = part ? &*part : &frame_;
  std::optional<RecordReader> reader;
  if (!records_.empty()) with.records = &reader.emplace(records_);
  return metric_.squared(apply_filter(settings, *frame, with, task).rgb(layer::beauty));
}

std::vector<double> TuningFrame::squared_errors(const Contender& contender, const std::vector<FilterSettings>& settings,
                                                const Task& task) {
  const auto key = [&](const FilterSettings& s) { return contender.label + " " + s.text(); };
  std::vector<const FilterSettings*> fresh;
  for (const FilterSettings& s : settings)
    if (known_.try_emplace(key(s), -1.0).second) fresh.push_back(&s);
  std::vector<double> measured(fresh.size());
  // Filters that hold much at a time would hold it once for each thread.
  if (!fresh.empty() && fresh[0]->entry().scratch > kSharedScratch)
    for (size_t i = 0; i < fresh.size(); ++i) measured[i] = measure(contender, *fresh[i], quiet(task));
  else
    parallel_for(static_cast<int>(fresh.size()), quiet(task), [&](int i) {
      const auto at = static_cast<size_t>(i);
      measured[at] = measure(contender, *fresh[at], {1, {}, task.cancel});
    });
  for (size_t i = 0; i < fresh.size(); ++i) known_[key(*fresh[i])] = measured[i];
  std::vector<double> errors;
  for (const FilterSettings& s : settings) errors.push_back(known_.at(key(s)));
  return errors;
}

bool Contender::searches(const Parameter& p) const {
  return !p.candidates.empty() && std::find(fixed.begin(), fixed.end(), p.name) == fixed.end();
}

bool Contender::reads_guides(const FilterSettings& run) const {
  const auto is_of_guides = [](const std::vector<std::string>& names) {
    return std::any_of(names.begin(), names.end(), FeaturePlan::is_of_guides);
  };
  if (!guides) return false;
  if (run.entry().guides) return true;
  return run.uses_features() && is_of_guides(features.empty() ? run.preferred_features() : features);
}

std::string Contender::key() const {
  return fmt::format("{} {}\nweights {}\nfixed {}\npublished {}\nfeatures {}\nguides {}", settings.entry().name,
                     settings.text(), settings.weights(), join(fixed, " "), paper ? paper->text() : "",
                     join(features, " "), guides);
}

namespace {

/// Every combination of the candidates, or nothing where there are too many.
std::vector<FilterSettings> all_combinations(const Contender& contender) {
  std::vector<FilterSettings> list = {contender.settings};
  for (const Parameter& p : contender.settings.entry().parameters) {
    if (!contender.searches(p)) continue;
    if (list.size() * p.candidates.size() > kExhaustive) return {};
    std::vector<FilterSettings> longer;
    for (const FilterSettings& settings : list)
      for (FilterSettings& with : with_each_candidate(settings, p)) longer.push_back(std::move(with));
    list = std::move(longer);
  }
  return list;
}

FilterSettings random_setting(const Contender& contender, Rng& rng) {
  FilterSettings settings = contender.settings;
  for (const Parameter& p : contender.settings.entry().parameters)
    if (contender.searches(p)) {
      const auto count = static_cast<double>(p.candidates.size());
      settings.set(p, p.candidates[static_cast<size_t>(count * rng.uniform())]);
    }
  return settings;
}

}  // namespace

FilterSettings search(const Contender& contender, const std::vector<TuningFrame*>& frames, int restarts,
                      const Task& task) {
  const auto sum_of_logs = [&](const std::vector<FilterSettings>& settings) {
    std::vector<double> sums(settings.size());
    for (TuningFrame* frame : frames) {
      const std::vector<double> errors = frame->squared_errors(contender, settings, task);
      for (size_t i = 0; i < sums.size(); ++i) sums[i] += std::log(std::max(errors[i], 1e-12));
    }
    return sums;
  };
  FilterSettings best = contender.settings;
  const std::vector<Parameter>& parameters = best.entry().parameters;
  if (!contender.paper &&
      std::none_of(parameters.begin(), parameters.end(), [&](const Parameter& p) { return contender.searches(p); }))
    return best;
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
  const std::vector<FilterSettings> all = all_combinations(contender);
  if (!all.empty()) {
    take_better(all);
    return best;
  }
  const auto descend = [&](const Task& part) {
    for (int round = 0; round < kMostRounds; ++round) {
      bool changed = false;
      for (const Parameter& p : contender.settings.entry().parameters)
        if (contender.searches(p)) changed |= take_better(with_each_candidate(best, p));
      part.report((round + 1.0) / kMostRounds);
      if (!changed) break;
    }
  };
  const double part = 1.0 / (1 + restarts);
  descend(share(task, 0, part));
  Rng rng(1);
  for (int restart = 0; restart < restarts; ++restart) {
    const FilterSettings best_so_far = best;
    const double lowest_so_far = lowest;
    best = random_setting(contender, rng);
    lowest = sum_of_logs({best})[0];
    descend(share(task, (restart + 1) * part, (restart + 2) * part));
    if (lowest < lowest_so_far) continue;
    best = best_so_far;
    lowest = lowest_so_far;
  }
  return best;
}

}  // namespace brume
