#include "filters/api/recommend.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "base/error.h"
#include "base/text.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"

namespace brume {
namespace {

constexpr double kNoticeably = 1.1;  // times the merit, to be worth a word

bool has_guides(const Layers& frame) {
  const std::vector<std::string> names = frame.names();
  return std::any_of(names.begin(), names.end(), [](const std::string& name) { return is_guide(name); });
}

bool can_run(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options) {
  if (filter.entry().guides && !has_guides(frame)) return false;
  if (filter.entry().learned) return false;  // what is recommended does not depend on files elsewhere
  try {
    check_requirements(filter, frame, options);
  } catch (const InputError&) {
    return false;
  }
  // Where halves are of use, the defaults use them.
  const FilterEntry& entry = filter.entry();
  const bool halves = has_halves(frame, signals_of(options).front());
  return halves || entry.makes_halves || entry.statistics == Statistics::kNone ||
         entry.can_use_statistics < Statistics::kHalves;
}

bool has_features(const Layers& frame) {
  const std::vector<LayerName>& sources = FeaturePlan::sources();
  return std::any_of(sources.begin(), sources.end(), [&](const LayerName& l) { return frame.has(l); });
}

/// What a frame lacks for a filter, as the option that records it; empty where the filter could not be helped so.
std::string lacking(const FilterEntry& filter, const Layers& frame, const ApplyOptions& options) {
  std::vector<std::string> layers;
  for (const LayerName& l : required_layers(filter, options))
    if (!frame.has(l) && !l.name.empty()) layers.push_back(std::string(l.name));
  if (!layers.empty()) return fmt::format("--layers ...,{}", join(layers, ","));
  if (filter.guides && !has_guides(frame)) return "--layers ...,guides";
  const LayerName signal = signals_of(options).front();
  if (filter.statistics >= Statistics::kVariance && !frame.has(signal, statistic::half_a)) return "statistics";
  if (filter.statistics == Statistics::kBuckets && !frame.has(signal, statistic::buckets[0])) return "--buckets";
  return "";
}

}  // namespace

Recommendation recommend_filter(const Layers& frame, const ApplyOptions& options, bool sequence) {
  const std::vector<const FilterEntry*> entries = filters_by_merit();
  const auto best = std::find_if(entries.begin(), entries.end(), [&](const FilterEntry* e) {
    return (!sequence || e->sequences) && can_run(FilterSettings(*e), frame, options);
  });
  if (best == entries.end()) {
    check_requirements(find_filter("gaussian"), frame, options);  // it needs least: its error says why none can
    throw InputError("no filter can run with these options; name one with -f to learn why");
  }
  const FilterSettings filter(**best);
  std::vector<std::string> wanted;
  std::set<std::string> told;
  for (auto e = entries.begin(); e != best && (*e)->merit > kNoticeably * (*best)->merit; ++e)
    if (const std::string what = lacking(**e, frame, options); !what.empty() && told.insert(what).second)
      wanted.push_back(fmt::format("{} for {}", what, (*e)->name));
  if (filter.uses_features() && !has_features(frame))
    wanted.push_back("features (--layers transmittance,gradient,...)");
  std::string reason = fmt::format("{}: the best filter for the layers of this frame", filter.entry().name);
  if (!wanted.empty()) reason += fmt::format("; more of brume render would make it better: {}", join(wanted));
  return {filter, reason};
}

}  // namespace brume
