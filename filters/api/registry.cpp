#include "filters/api/registry.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "base/error.h"
#include "base/text.h"

namespace brume {
namespace {

std::vector<const FilterEntry*>& mutable_registry() {
  static std::vector<const FilterEntry*> entries;
  return entries;
}

}  // namespace

Registration::Registration(const FilterEntry& entry) {
  auto& entries = mutable_registry();
  entries.push_back(&entry);
  std::sort(entries.begin(), entries.end(),
            [](const FilterEntry* a, const FilterEntry* b) { return a->name < b->name; });
}

const std::vector<const FilterEntry*>& all_filters() {
  return mutable_registry();
}

std::vector<const FilterEntry*> filters_by_merit() {
  std::vector<const FilterEntry*> entries = all_filters();
  std::stable_sort(entries.begin(), entries.end(),
                   [](const FilterEntry* a, const FilterEntry* b) { return a->merit > b->merit; });
  return entries;
}

const FilterEntry& find_filter(std::string_view name) {
  std::vector<std::string> names;
  for (const FilterEntry* entry : all_filters()) {
    if (entry->name == name) return *entry;
    names.push_back(entry->name);
  }
  throw InputError(fmt::format("no filter '{}'{}", name, suggestion(name, names)));
}

FilterSettings parse_filter(std::string_view text) {
  const size_t colon = std::min(text.find(':'), text.size());
  FilterSettings settings(find_filter(text.substr(0, colon)));
  if (colon < text.size())
    for (const auto& [name, value] : parse_assignments(text.substr(colon + 1))) settings.set(name, value);
  return settings;
}

std::vector<std::pair<std::string, std::string>> parse_assignments(std::string_view text) {
  std::vector<std::pair<std::string, std::string>> assignments;
  if (text.empty()) return assignments;
  for (const std::string& assignment : split(std::string(text), ',')) {
    const size_t equals = assignment.find('=');
    if (equals == std::string::npos) throw InputError(fmt::format("'{}': expected parameter=value", assignment));
    assignments.emplace_back(assignment.substr(0, equals), assignment.substr(equals + 1));
  }
  return assignments;
}

std::vector<std::string> names_of(FeatureSet set) {
  switch (set) {
    case FeatureSet::kScalar:
      return {"opacity", "scatter-depth", "single", "albedo", "surface-depth"};
    case FeatureSet::kOpacity:
      return {"opacity"};
    case FeatureSet::kGuides:
      return {std::string(FeaturePlan::kGuides)};
    default:
      return {};
  }
}

std::vector<std::pair<std::string, std::string>> FilterEntry::inputs_and_outputs() const {
  std::vector<std::pair<std::string, std::string>> lines;
  for (const LayerName& l : needs) lines.emplace_back("needs", fmt::format("the layer `{}`, {}", l.label(), l.meaning));
  for (const LayerName& l : can_use)
    lines.emplace_back("can use", fmt::format("the layer `{}`, {}", l.label(), l.meaning));
  constexpr std::array kStatistics = {"", "variance", "two half images", "eight bucket means"};
  if (statistics > Statistics::kNone)
    lines.emplace_back("needs", fmt::format("of what it cleans: {}", kStatistics[static_cast<size_t>(statistics)]));
  if (can_use_statistics > statistics)
    lines.emplace_back("can use",
                       fmt::format("of what it cleans: {}", kStatistics[static_cast<size_t>(can_use_statistics)]));
  if (noise_level) lines.emplace_back("can use", "of what it cleans: two half images or variance (`noise-factor`)");
  if (features) lines.emplace_back(needs_features ? "needs" : "can use", "features");
  if (records != Records::kNo)
    lines.emplace_back(records == Records::kNeeds ? "needs" : "can use", "the record of every sample (`--records`)");
  if (sequences)
    lines.emplace_back("can", fmt::format("look into the frames before and after (`--frames`, `--extra-frames {}`){}",
                                          frame_window, aligned ? ", aligned with the frame" : ""));
  if (carries) lines.emplace_back("can", "carry other layers along (`--carry`)");
  for (const LayerName& l : produces)
    lines.emplace_back("writes", fmt::format("the layer `{}`, {}", l.label(), l.meaning));
  for (const Preset& p : presets) {
    std::vector<std::string> settings;
    for (const auto& [parameter, value] : p.settings) settings.push_back(parameter + "=" + value);
    lines.emplace_back("preset", fmt::format("`{}`, {}: {}", p.name, p.summary,
                                             settings.empty() ? "the defaults" : "`" + join(settings, ",") + "`"));
  }
  return lines;
}

std::string Parameter::text(const Value& value) {
  if (const double* number = std::get_if<double>(&value)) return fmt::format("{:.6g}", *number);
  return std::get<std::string>(value);
}

std::string Parameter::range() const {
  if (is_text) return "a text";
  if (!choices.empty()) return "one of " + join(choices);
  return fmt::format("{} in {:.6g} .. {:.6g}{}", integer ? "an integer" : "a number", lowest, highest,
                     unit.empty() || unit == "1" ? "" : " " + unit);
}

const Parameter* FilterEntry::find(std::string_view parameter) const {
  for (const Parameter& p : parameters)
    if (p.name == parameter) return &p;
  return nullptr;
}

const Preset& FilterEntry::find_preset(std::string_view preset) const {
  std::vector<std::string> names;
  for (const Preset& p : presets) {
    if (p.name == preset) return p;
    names.push_back(p.name);
  }
  throw InputError(fmt::format("filter {} has no preset '{}'{}", name, preset, suggestion(preset, names)));
}

void FilterSettings::set(const std::string& parameter, const std::string& text) {
  if (parameter != "preset") {
    assign(parameter, text);
    assigned_.emplace_back(parameter, text);
    return;
  }
  const Preset& preset = entry_->find_preset(text);
  parameters_ = entry_->defaults;
  for (const auto& [name, value] : preset.settings) assign(name, value);
  for (const auto& [name, value] : assigned_) assign(name, value);
}

void FilterSettings::assign(const std::string& parameter, const std::string& text) {
  const Parameter* p = entry_->find(parameter);
  if (!p) {
    std::vector<std::string> names;
    for (const Parameter& known : entry_->parameters) names.push_back(known.name);
    throw InputError(
        fmt::format("filter {} has no parameter '{}'{}", entry_->name, parameter, suggestion(parameter, names)));
  }
  const auto fail = [&] {
    throw InputError(fmt::format("filter {}: {} = '{}'; expected {}", entry_->name, parameter, text, p->range()));
  };
  if (!p->choices.empty()) {
    if (std::find(p->choices.begin(), p->choices.end(), text) == p->choices.end()) fail();
    return set(*p, text);
  }
  if (p->is_text) return set(*p, text);
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end || !(value >= p->lowest && value <= p->highest) ||
      (p->integer && value != std::floor(value)))
    fail();
  set(*p, value);
}

std::string FilterSettings::text() const {
  std::string text;
  for (const Parameter& p : entry_->parameters)
    text += fmt::format("{}{}={}", text.empty() ? "" : " ", p.name, Parameter::text(get(p)));
  return text;
}

namespace {

std::string merit_table() {
  std::string rows;
  for (const FilterEntry* e : filters_by_merit())
    rows += fmt::format("| [`{}`](#{}) | {:.3g} | {} |\n", e->name, e->name, e->merit, e->when);
  return rows;
}

}  // namespace

std::string filters_reference(std::string_view insertion) {
  std::string text =
      "# Filters\n"
      "\n"
      "`brume denoise IN.exr -o OUT.exr` takes the best filter that the frame's layers allow and says which. `-f NAME --PARAMETER VALUE`, or\n"
      "`-f NAME:parameter=value,...`, names one; `-f A --radius 3 -f B --radius 4` runs several: what follows a filter is its own, what stands\n"
      "before the first `-f` goes to all. This page is written by `brume docs filters`; a test compares it with the code.\n"
      "\n"
      "## Which to take\n"
      "\n"
      "Worth: the result is as good, by squared error at the defaults, as path tracing with this many times the samples\n"
      "([results.md](results.md)).\n"
      "\n"
      "| filter | worth | take it |\n"
      "|---|---:|---|\n" +
      merit_table() +
      "\n"
      "## What is common to all\n"
      "\n"
      "- **Component**: `all`, the default of `brume denoise`, cleans the whole picture; `indirect`, the default of `brume evaluate` and the\n"
      "  rule of the papers, cleans the `indirect` layer and adds `direct` back untouched; `separate` cleans both, each by itself, as\n"
      "  `transport_regression` always does.\n"
      "- **Windows**: the data window is cleaned, overscan included; a crop has no black around it.\n"
      "- **Carried layers**: `--carry direct,indirect` filters these layers with the weights of the picture, so that passes which add up\n"
      "  before the filter add up after it.\n"
      "- **Presets**: `-f NAME:preset=paper` takes the published parameters; the defaults were chosen on scenes that no table of\n"
      "  [results.md](results.md) reports. Parameters given by name stand above a preset.\n"
      "- **Noise**: variance comes from the frame's `mean_variance`; its level is corrected by the two halves, because low-discrepancy samples\n"
      "  vary less than it says. `--noise spatial` estimates it from the picture, for frames without statistics.\n"
      "- **Features**: " +
      join(FeaturePlan::names()) +
      ", made from the layers that a\n"
      "  frame has and scaled so that their 1st to 99th percentile is [0, 1]. What is absent, constant or noisier than its signal is left out,\n"
      "  with a note. `--features` chooses; `--features guides` takes all that are made from the renderer's guides, which no filter does unasked.\n"
      "- **Outliers**: before the filter, single samples far brighter than everything around them are limited; their light goes to the\n"
      "  neighbourhood, of which one sample adds no more than 3 %. What both halves show, as a lamp or a star, is kept. `--outliers clamp` limits\n"
      "  all fireflies that stand out of their noise, `redistribute` hands their light to their neighbours, `keep` leaves everything; the light\n"
      "  concerned is reported.\n"
      "- **Background**: pixels without coverage get the bilateral filter in the filters of the gradient-kernel paper; the others treat every\n"
      "  pixel. `--background` says otherwise.\n"
      "- **Size**: a frame that needs more room than a quarter of the layers read is filtered tile by tile (`--tile`).\n"
      "- **Averages**: the perceptual filters work in CIE-Lab of radiance times the frame's exposure, and average there (`average=domain`, as\n"
      "  published, which darkens noisy pixels) or in linear light with the weights from Lab (`average=linear`).\n";
  text += insertion;
  for (const FilterEntry* e : all_filters()) {
    text += fmt::format("\n## `{}`\n\n{} Source: {}.\n", e->name, e->summary, e->source);
    if (!e->notes.empty()) text += e->notes + "\n";
    text += "\n";
    std::vector<std::string> facts;
    for (const auto& [verb, what] : e->inputs_and_outputs()) facts.push_back(fmt::format("{} {}", verb, what));
    if (!facts.empty()) text += "Layers and options: " + join(facts, "; ") + ".\n\n";
    text += "| parameter | default | range | searched when tuned | meaning |\n|---|---|---|---|---|\n";
    const FilterSettings settings(*e);
    for (const Parameter& p : e->parameters) {
      std::vector<std::string> candidates;
      for (const Parameter::Value& v : p.candidates) candidates.push_back(Parameter::text(v));
      text += fmt::format("| `{}` | {} | {} | {} | {} |\n", p.name, Parameter::text(settings.get(p)), p.range(),
                          join(candidates), p.help);
    }
  }
  return text;
}

}  // namespace brume
