#include "evaluate/protocol/studies.h"

#include <algorithm>

#include "filters/inputs/guide_layers.h"

namespace brume {
namespace {

/// "guide.single" of "guide.single.sun".
std::string guide_group(const std::string& channel) {
  const size_t first = kGuidePrefix.size(), end = channel.find('.', first);
  return channel.substr(0, end);
}

/// "guide.predicted_direct" for the feature "guide-direct"; a feature that is made of no guide is itself.
std::string layer_of(const std::string& feature) {
  constexpr std::string_view kPredicted = "predicted_";
  for (const LayerName& source : FeaturePlan::sources()) {
    if (!is_guide(source.name)) continue;
    std::string_view what = source.name.substr(kGuidePrefix.size());
    if (what.starts_with(kPredicted)) what.remove_prefix(kPredicted.size());
    if (feature == "guide-" + std::string(what)) return std::string(source.name);
  }
  return feature;
}

/// The features that a filter gets by itself on this frame.
std::vector<std::string> features_of(const Contender& contender, const FilterSettings& settings, const Layers& frame,
                                     const Task& task) {
  if (!settings.uses_features()) return {};
  std::vector<std::string> chosen = contender.features.empty() ? settings.preferred_features() : contender.features;
  if (chosen == std::vector<std::string>{"none"}) return {};
  const bool all_guides = std::find(chosen.begin(), chosen.end(), FeaturePlan::kGuides) != chosen.end();
  std::vector<std::string> present;
  for (const std::string& name : FeaturePlan::names()) {
    const bool of_guides = FeaturePlan::is_of_guides(name);
    const bool taken = chosen.empty()
                           ? !of_guides
                           : (all_guides && of_guides) || std::find(chosen.begin(), chosen.end(), name) != chosen.end();
    if (taken && !FeaturePlan(frame, {name}, quiet(task)).empty()) present.push_back(name);
  }
  return present;
}

FilterRun with(FilterRun run, const std::vector<StudiedLayer>& all, const std::vector<bool>& kept) {
  std::vector<std::string> features;
  bool any_feature = false;
  for (size_t i = 0; i < all.size(); ++i) {
    if (all[i].is_feature) {
      any_feature = true;
      if (kept[i]) features.push_back(all[i].name);
    } else if (!kept[i]) {
      run.left_out.push_back(all[i].name);
    }
  }
  if (any_feature) run.options.features = features.empty() ? std::vector<std::string>{"none"} : features;
  return run;
}

}  // namespace

std::vector<StudiedLayer> layers_to_study(const Contender& contender, const FilterSettings& settings,
                                          const Layers& frame, const Task& task) {
  std::vector<StudiedLayer> layers;
  for (const std::string& name : features_of(contender, settings, frame, task))
    layers.push_back({name, true, layer_of(name)});
  if (settings.entry().guides && contender.guides)
    for (const auto& [channel, plane] : frame.channels()) {
      if (!channel.starts_with(kGuidePrefix)) continue;
      const std::string group = guide_group(channel);
      if (std::none_of(layers.begin(), layers.end(), [&](const StudiedLayer& l) { return l.name == group; }))
        layers.push_back({group, false, group});
    }
  return layers;
}

FilterRun without_layer(const FilterRun& run, const std::vector<StudiedLayer>& all, size_t index) {
  std::vector<bool> kept(all.size(), true);
  kept[index] = false;
  return with(run, all, kept);
}

FilterRun with_layer_alone(const FilterRun& run, const std::vector<StudiedLayer>& all, size_t index) {
  std::vector<bool> kept(all.size(), false);
  kept[index] = true;
  return with(run, all, kept);
}

std::vector<StudiedParameter> parameters_to_study(const Contender& contender, const FilterSettings& settings) {
  std::vector<StudiedParameter> list;
  for (const Parameter& p : settings.entry().parameters) {
    if (!contender.searches(p)) continue;
    std::vector<Parameter::Value> values = p.candidates;
    if (std::find(values.begin(), values.end(), settings.get(p)) == values.end()) values.push_back(settings.get(p));
    if (p.choices.empty()) std::sort(values.begin(), values.end());
    StudiedParameter& studied = list.emplace_back(StudiedParameter{p.name, {}});
    for (const Parameter::Value& value : values) {
      FilterSettings changed = settings;
      changed.set(p, value);
      studied.values.emplace_back(Parameter::text(value), std::move(changed));
    }
  }
  return list;
}

}  // namespace brume
