#include "evaluate/protocol/settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>

#include "base/text.h"
#include "evaluate/protocol/external_filter.h"
#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"

namespace brume {

std::string remark_on_parts(const EvaluationSettings& settings) {
  std::vector<std::string> names;
  for (const Contender& c : settings.contenders)
    if (c.settings.entry().parts) names.push_back(c.label);
  if (settings.component != Component::kIndirect || names.empty()) return "";
  return fmt::format(
      "{} clean{} the direct light as well, which the others leave noisy here: --component all compares them alike",
      join(names), names.size() == 1 ? "s" : "");
}

bool is_any_searched(const EvaluationSettings& settings) {
  return settings.tune || settings.ablation || settings.sensitivity;
}

std::string remark_on_others(const EvaluationSettings& settings) {
  std::vector<std::string> names;
  for (const Contender& c : settings.contenders)
    if (c.external) names.push_back(fmt::format("{} is `{}`", c.label, c.external->words));
  if (names.empty() || !is_any_searched(settings)) return join(names, "; ");
  return fmt::format(
      "{}: no parameters of {} are known, so that nothing is searched or studied, and {} under each setting",
      join(names, "; "), names.size() == 1 ? "it" : "theirs",
      names.size() == 1 ? "it stands as it is" : "they stand as they are");
}

bool is_reported(const EvaluationSettings& settings, const std::string& metric) {
  const std::vector<std::string>& chosen = settings.metrics;
  return chosen.empty() || std::find(chosen.begin(), chosen.end(), metric) != chosen.end();
}

namespace {

/// Whether any of the settings that will run reads features.
bool reads_features(const Contender& contender, bool tune) {
  if (contender.settings.uses_features() || (contender.paper && contender.paper->uses_features())) return true;
  if (!tune) return false;
  const std::vector<FilterSettings> all = candidate_settings(contender);
  return std::any_of(all.begin(), all.end(), [](const FilterSettings& s) { return s.uses_features(); });
}

/// Whether any of them prefers features that are made from guides.
bool prefers_guides(const Contender& contender, bool tune) {
  const auto prefers = [](const FilterSettings& s) {
    const std::vector<std::string> names = s.preferred_features();
    return s.uses_features() && std::any_of(names.begin(), names.end(), FeaturePlan::is_of_guides);
  };
  if (std::any_of(contender.features.begin(), contender.features.end(), FeaturePlan::is_of_guides)) return true;
  if (prefers(contender.settings)) return true;
  if (!tune) return false;
  const std::vector<FilterSettings> all = candidate_settings(contender);
  return std::any_of(all.begin(), all.end(), prefers);
}

}  // namespace

RecordedData data_of_references() {
  return {{"coverage", "direct", "indirect"}, false, false, false};
}

RecordedData data_to_record(const EvaluationSettings& settings) {
  if (settings.all_layers) {
    EvaluationSettings all = settings;
    all.all_layers = false;
    all.tune = true;
    for (Contender& other : all_contenders()) all.contenders.push_back(std::move(other));
    return data_to_record(all);
  }
  std::set<std::string> names = {"coverage"};  // the mask of medium pixels
  RecordedData data;
  for (const Contender& contender : settings.contenders) {
    const FilterEntry& filter = contender.settings.entry();
    std::vector<LayerName> layers = required_layers(filter, {settings.component, settings.background});
    if (filter.parts) layers.insert(layers.end(), {layer::direct, layer::indirect});
    layers.insert(layers.end(), filter.can_use.begin(), filter.can_use.end());
    const bool features =
        contender.features != std::vector<std::string>{"none"} && reads_features(contender, settings.tune);
    if (features) layers.insert(layers.end(), FeaturePlan::sources().begin(), FeaturePlan::sources().end());
    for (const LayerName& l : layers)
      if (!l.name.empty() && !is_guide(l.name)) names.insert(std::string(l.name));
    if (contender.guides && (filter.guides || prefers_guides(contender, settings.tune))) names.insert("guides");
    data.statistics |= filter.can_use_statistics >= Statistics::kVariance || features || filter.variances;
    data.buckets |= filter.can_use_statistics >= Statistics::kBuckets;
    data.records |= filter.records == FilterEntry::Records::kNeeds;
  }
  data.layers = {names.begin(), names.end()};
  return data;
}

std::string processor_name() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

std::string RecordedData::text() const {
  return fmt::format("layers {}\nstatistics {}\nbuckets {}\nrecords {}", join(layers, " "), statistics, buckets,
                     records);
}

}  // namespace brume
