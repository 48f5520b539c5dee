#include "filters/api/requirements.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.h"
#include "base/text.h"
#include "filters/api/registry.h"
#include "filters/inputs/guide_layers.h"

namespace brume {
namespace {

void check_layers(const FilterEntry& filter, const Layers& frame, const ApplyOptions& options) {
  std::vector<std::string> missing, record;
  for (const LayerName& l : required_layers(filter, options))
    if (!frame.has(l)) {
      missing.push_back("'" + l.label() + "'");
      if (!l.name.empty()) record.push_back(std::string(l.name));
    }
  if (missing.empty()) return;
  const std::vector<std::string> names = layer_names(frame);
  const std::string there = names.empty() ? "it has none" : "it has: " + join(names);
  if (options.component == Component::kAll && !frame.has(layer::beauty))
    throw InputError(fmt::format("has no channels R, G, B to clean; {}", there));
  for (const LayerName& l : {layer::direct, layer::indirect, layer::gradient, layer::coverage, layer::transmittance})
    if (frame.has(l) && std::find(record.begin(), record.end(), l.name) == record.end())
      record.push_back(std::string(l.name));
  // --component all helps only where nothing but the split is missing.
  const bool only_split =
      std::all_of(filter.needs.begin(), filter.needs.end(), [&](const LayerName& l) { return frame.has(l); });
  const std::string way_out =
      !only_split ? "; other renderers do not record what it needs: take another filter for their frames"
      : options.component != Component::kAll ? "; or clean the whole picture with --component all"
                                             : "";
  throw InputError(fmt::format(
      "filter {} needs the layer{} {}, which the frame does not have ({}). {}", filter.name,
      missing.size() > 1 ? "s" : "", join(missing), there,
      way_to(fmt::format("Record it with: brume render SCENE -o OUT.exr --layers {}{}", join(record, ","), way_out),
             frame)));
}

void check_statistics(const FilterSettings& settings, const Layers& frame, const ApplyOptions& options) {
  const FilterEntry& filter = settings.entry();
  for (const LayerName& signal : signals_of(options)) {
    const auto need = [&](std::string_view statistic, const std::string& what, const std::string& how) {
      if (!frame.has(signal, statistic))
        throw InputError(
            fmt::format("filter {} needs {} of '{}' (channel {} and its like), which the frame does not have. {}",
                        filter.name, what, signal.label(), signal.channel_of(statistic, 0), how));
    };
    const bool halves = has_halves(frame, signal);
    if (filter.statistics == Statistics::kVariance && options.noise == NoiseSource::kLayers && !halves)
      need(
          statistic::mean_variance, "the variance",
          way_to(
              "brume render records it unless --no-statistics is given; for other frames, --noise spatial estimates it from the picture",
              frame, "--noise spatial estimates it from the picture, or "));
    if (limits_outliers(options) && options.noise == NoiseSource::kLayers && !halves &&
        !frame.has(signal, statistic::mean_variance))
      throw InputError(fmt::format(
          "limiting outliers needs the variance of '{}', which the frame does not have; --noise spatial estimates it from the picture",
          signal.label()));
    if (settings.uses_noise_level() && options.noise == NoiseSource::kLayers && !halves)
      need(statistic::mean_variance, "the variance or the two half images",
           "noise-factor measures the noise from them; --noise spatial estimates it from the picture");
    if (filter.statistics == Statistics::kHalves) {
      need(statistic::half_a, "the two half images",
           way_to("brume render records them unless --no-statistics is given; a filter that needs none is bilateral",
                  frame, "say with --map which of its layers are its halves, or "));
      if (!halves)
        throw InputError(fmt::format(
            "filter {} needs two half images of '{}', and with one sample per pixel the second is empty. Render with --spp 2 or more; a filter that needs none is bilateral",
            filter.name, signal.label()));
    }
    if (filter.statistics == Statistics::kBuckets &&
        !(options.records && filter.records == FilterEntry::Records::kCanUse))
      need(statistic::buckets[0], "the eight bucket means",
           way_to("Record them with: brume render SCENE -o OUT.exr --buckets", frame));
  }
  if (filter.records == FilterEntry::Records::kNeeds && !options.records)
    throw InputError(fmt::format(
        "filter {} needs the record of every sample. {}", filter.name,
        way_to(
            "Record it with: brume render SCENE -o OUT.exr --records OUT.records, then brume denoise OUT.exr --records OUT.records ...",
            frame)));
  if (!options.carried.empty() && !filter.carries) {
    std::vector<std::string> able;
    for (const FilterEntry* e : all_filters())
      if (e->carries) able.push_back(e->name);
    throw InputError(fmt::format("filter {} cannot filter other layers with the weights of one; these can: {}",
                                 filter.name, join(able)));
  }
  if (!options.carried.empty() && options.component == Component::kSeparate)
    throw InputError("carrying layers along takes one component's weights: indirect or all, not separate");
  if (!options.carried.empty() && limits_outliers(options))
    throw InputError(
        "carried layers would keep the light that --outliers takes from what carries them; use one of both");
  for (const LayerName& l : options.carried)
    if (!frame.has(l)) throw InputError(fmt::format("the frame has no layer '{}' to carry along", l.label()));
}

void check_features(const FilterEntry& filter, const Layers& frame, const ApplyOptions& options) {
  if (!filter.needs_features) return;
  const std::vector<LayerName>& sources = FeaturePlan::sources();
  const bool none_wanted = options.features == std::vector<std::string>{"none"};
  if (!none_wanted && std::any_of(sources.begin(), sources.end(), [&](const LayerName& l) { return frame.has(l); }))
    return;
  std::vector<std::string> names;
  for (const LayerName& l : sources)
    if (!is_guide(l.name)) names.push_back(std::string(l.name));
  names.push_back("guides");
  throw InputError(
      fmt::format("filter {} is led by features, and {}. They are made from the layers {}: {}", filter.name,
                  none_wanted ? "--features none leaves it none" : "the frame has none", join(names),
                  way_to("brume render SCENE -o OUT.exr --layers ...; without them take another filter", frame)));
}

void check_frame(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options) {
  check_layers(filter.entry(), frame, options);
  check_features(filter.entry(), frame, options);
  check_statistics(filter, frame, options);
}

}  // namespace

std::string way_to(const std::string& recording, const Layers& frame, const std::string& other) {
  const std::string renderer = frame.text(kForeignRenderer);
  if (renderer.empty()) return recording;
  return fmt::format(
      "This frame is by another renderer (read as {}): {}take a filter that needs none; without -f the best for the frame is taken",
      renderer, other);
}

std::vector<std::string> layer_names(const Layers& frame) {
  std::set<std::string> names;
  for (const std::string& channel : frame.names()) {
    const size_t dot = channel.rfind('.');
    std::string name = dot != std::string::npos   ? channel.substr(0, dot)
                       : frame.has(layer::beauty) ? "beauty"
                                                  : channel;
    const auto is_part = [&](std::string_view statistic) {
      return name == statistic || name.ends_with("." + std::string(statistic));
    };
    const bool of_a_layer = is_part(statistic::mean_variance) || is_part(statistic::half_a) ||
                            is_part(statistic::half_b) ||
                            std::any_of(statistic::buckets.begin(), statistic::buckets.end(), is_part);
    if (!of_a_layer) names.insert(std::move(name));
  }
  return {names.begin(), names.end()};
}

ApplyOptions options_for(const FilterEntry& filter, const Layers& frame, const ApplyOptions& wanted) {
  ApplyOptions options = wanted;
  if (filter.parts && options.component == Component::kAll && frame.has(layer::direct) && frame.has(layer::indirect))
    options.component = Component::kSeparate;
  return options;
}

bool limits_outliers(const ApplyOptions& options) {
  return options.outliers == Outliers::kClamp || options.outliers == Outliers::kRedistribute;
}

std::vector<LayerName> signals_of(const ApplyOptions& options) {
  switch (options.component) {
    case Component::kAll:
      return {layer::beauty};
    case Component::kSeparate:
      return {layer::indirect, layer::direct};
    default:
      return {layer::indirect};
  }
}

std::vector<LayerName> required_layers(const FilterEntry& filter, const ApplyOptions& options) {
  std::vector<LayerName> layers;
  if (options.component == Component::kAll)
    layers = {layer::beauty};
  else
    layers = {layer::direct, layer::indirect};
  for (const LayerName& l : filter.needs)
    if (std::find(layers.begin(), layers.end(), l) == layers.end()) layers.push_back(l);
  return layers;
}

std::set<std::string> readable_channels(const FilterSettings& settings, const ApplyOptions& wanted,
                                        const Layers& frame) {
  const FilterEntry& filter = settings.entry();
  const ApplyOptions options = options_for(filter, frame, wanted);
  std::set<std::string> names;
  if (filter.guides)
    for (const auto& [name, plane] : frame.channels())
      if (is_guide(name)) names.insert(name);
  const auto add = [&](const LayerName& l, std::string_view statistic = "") {
    for (const std::string& name : l.channel_names(statistic)) names.insert(name);
  };
  for (const LayerName& l : required_layers(filter, options)) add(l);
  for (const LayerName& l : filter.can_use) add(l);
  if (filter.variances)
    for (const std::vector<LayerName>& list : {filter.needs, filter.can_use})
      for (const LayerName& l : list) add(l, statistic::mean_variance);
  for (const LayerName& l : options.carried) add(l);
  for (const LayerName& l : {layer::coverage, layer::alpha}) add(l);
  const Statistics statistics = std::max(filter.statistics, filter.can_use_statistics);
  const bool limits = limits_outliers(options), extremes = options.outliers == Outliers::kExtreme;
  for (const LayerName& l : signals_of(options)) {
    if (statistics >= Statistics::kVariance || extremes)
      for (const auto which : {statistic::half_a, statistic::half_b}) add(l, which);
    if ((statistics >= Statistics::kVariance && filter.signal_variance) || limits) add(l, statistic::mean_variance);
    if (statistics >= Statistics::kBuckets || limits)
      for (const auto which : statistic::buckets) add(l, which);
  }
  if (settings.uses_noise_level() && options.noise == NoiseSource::kLayers)
    for (const LayerName& l : signals_of(options))
      for (const auto which : {statistic::mean_variance, statistic::half_a, statistic::half_b}) add(l, which);
  if (statistics >= Statistics::kVariance || extremes) add(layer::sample_count);
  if (settings.uses_features())
    for (const LayerName& l : FeaturePlan::sources())
      for (const auto which : {std::string_view(), statistic::mean_variance, statistic::half_a, statistic::half_b})
        add(l, which);
  return names;
}

void check_requirements(const FilterSettings& filter, const Layers& frame, const ApplyOptions& wanted) {
  const ApplyOptions options = options_for(filter.entry(), frame, wanted);
  check_frame(filter, frame, options);
  filter.weights();
  const FilterEntry& entry = filter.entry();
  if (!options.sequence.empty() && !entry.sequences) {
    std::vector<std::string> able;
    for (const FilterEntry* e : all_filters())
      if (e->sequences) able.push_back(e->name);
    throw InputError(
        fmt::format("filter {} cleans every frame by itself; these look into the frames before and after: {}",
                    entry.name, join(able)));
  }
  for (const SequenceFrame& other : options.sequence) {
    ApplyOptions theirs = options;
    theirs.records = other.records;
    try {
      if (other.layers->width() != frame.width() || other.layers->height() != frame.height())
        throw InputError(fmt::format("it has {} x {} pixels, the frame to clean {} x {}", other.layers->width(),
                                     other.layers->height(), frame.width(), frame.height()));
      if (other.layers->origin != frame.origin)
        throw InputError(fmt::format("its data window is {}, that of the frame to clean {}",
                                     other.layers->data_window().text(), frame.data_window().text()));
      check_frame(filter, *other.layers, theirs);
    } catch (const InputError& error) {
      throw InputError(fmt::format("the frame at {:+} of the sequence: {}", other.distance, error.what()));
    }
  }
}

}  // namespace brume
