#include "workflows/filters_json.h"

#include <nlohmann/json.hpp>

namespace brume {
namespace {

nlohmann::json to_json(const Parameter::Value& v) {
  return std::visit([](const auto& x) -> nlohmann::json { return x; }, v);
}

nlohmann::json to_json(const FilterEntry& e) {
  nlohmann::json parameters = nlohmann::json::array();
  const FilterSettings settings(e);
  for (const Parameter& p : e.parameters) {
    nlohmann::json j = {{"name", p.name}, {"default", to_json(settings.get(p))}, {"unit", p.unit}, {"help", p.help}};
    if (!p.choices.empty())
      j["choices"] = p.choices;
    else if (!p.is_text)
      j["range"] = {p.lowest, p.highest};
    parameters.push_back(j);
  }
  nlohmann::json needs = nlohmann::json::array(), can_use = nlohmann::json::array();
  for (const LayerName& l : e.needs) needs.push_back(l.label());
  for (const LayerName& l : e.can_use) can_use.push_back(l.label());
  nlohmann::json reads = nlohmann::json::array();
  for (const auto& [verb, what] : e.inputs_and_outputs()) reads.push_back(verb + ": " + what);
  return {{"name", e.name},          {"merit", e.merit},   {"take_it", e.when},
          {"summary", e.summary},    {"source", e.source}, {"notes", e.notes},
          {"needs", needs},          {"can_use", can_use}, {"inputs_and_outputs", reads},
          {"parameters", parameters}};
}

}  // namespace

std::string filters_json(const std::vector<const FilterEntry*>& filters) {
  nlohmann::json list = nlohmann::json::array();
  for (const FilterEntry* filter : filters) list.push_back(to_json(*filter));
  return nlohmann::json{{"filters", list}}.dump(2, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace brume
