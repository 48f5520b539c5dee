#include "filters/registry.h"

#include <fmt/format.h>

#include <algorithm>
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

std::string layer_list(const std::vector<LayerName>& layers) {
  std::vector<std::string> names;
  for (const LayerName& l : layers) names.push_back("`" + l.label() + "`");
  return names.empty() ? "none" : join(names);
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
    for (const std::string& assignment : split(text.substr(colon + 1), ',')) {
      const size_t equals = assignment.find('=');
      if (equals == std::string::npos)
        throw InputError(fmt::format("'{}' in '{}': expected parameter=value", assignment, text));
      settings.set(assignment.substr(0, equals), assignment.substr(equals + 1));
    }
  return settings;
}

std::string Parameter::text(const Value& value) {
  if (const double* number = std::get_if<double>(&value)) return fmt::format("{:.6g}", *number);
  return std::get<std::string>(value);
}

std::string Parameter::range() const {
  if (!choices.empty()) return "one of " + join(choices);
  return fmt::format("{} in {:.6g} .. {:.6g}{}", integer ? "an integer" : "a number", lowest, highest,
                     unit.empty() || unit == "1" ? "" : " " + unit);
}

const Parameter* FilterEntry::find(std::string_view parameter) const {
  for (const Parameter& p : parameters)
    if (p.name == parameter) return &p;
  return nullptr;
}

void FilterSettings::set(const std::string& parameter, const std::string& text) {
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

std::string filters_reference() {
  std::string text =
      "# Filters\n\n"
      "Each is one file in `filters/`, with one declaration from which this page, the command line, the range checks, "
      "the\n"
      "benchmark and the generic tests follow. `brume denoise IN.exr -f NAME -o OUT.exr --PARAMETER VALUE` runs one;\n"
      "`-f NAME:parameter=value,...` may be repeated to run several. This page is written by `brume docs filters`; a "
      "test\n"
      "keeps it in step with the code.\n\n"
      "All of them clean the `indirect` layer and add `direct` back untouched, or clean the whole `beauty` with\n"
      "`--component all`; pixels without coverage get the bilateral filter (`--background filter` treats them like the "
      "rest).\n"
      "The perceptual ones work in CIE-Lab of radiance times the frame's exposure, and average there (`average = "
      "domain`, as\n"
      "published, which darkens noisy pixels) or in linear light with the weights from Lab (`average = linear`, which "
      "keeps\n"
      "the mean).\n";
  for (const FilterEntry* e : all_filters()) {
    text += fmt::format("\n## `{}`\n\n{}\n\nSource: {}. Needs layers: {}. Can use: {}.\n\n", e->name, e->summary,
                        e->source, layer_list(e->needs), layer_list(e->can_use));
    if (!e->notes.empty()) text += e->notes + "\n\n";
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
