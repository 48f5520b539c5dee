#include <fmt/format.h>

#include "app/command.h"
#include "filters/registry.h"

namespace brume::app {
namespace {

nlohmann::json to_json(const Parameter::Value& v) {
  return std::visit([](const auto& x) -> nlohmann::json { return x; }, v);
}

nlohmann::json to_json(const FilterEntry& e) {
  nlohmann::json parameters = nlohmann::json::array();
  const FilterSettings settings(e);
  for (const Parameter& p : e.parameters) {
    nlohmann::json j = {{"name", p.name}, {"default", to_json(settings.get(p))}, {"unit", p.unit}, {"help", p.help}};
    if (p.choices.empty())
      j["range"] = {p.lowest, p.highest};
    else
      j["choices"] = p.choices;
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

void add_filters(CLI::App& app, Common& common, Commands& commands) {
  static std::string name;
  CLI::App* command =
      add_command(app, common, "filters",
                  "the filters, what serves best first: when to take which, their parameters, layers and sources");
  command->add_option("name", name, "one of them");
  command->add_flag("--json", common.json, "as one JSON object");
  commands[command] = [&common] {
    std::vector<const FilterEntry*> entries = filters_by_merit();
    if (!name.empty()) entries = {&find_filter(name)};
    nlohmann::json list = nlohmann::json::array();
    std::string text;
    for (const FilterEntry* e : entries) {
      list.push_back(to_json(*e));
      text += fmt::format(
          "{}\n  {}\n  take it {}\n  worth {:.3g} times the samples on media at its defaults\n  source: {}\n", e->name,
          e->summary, e->when, e->merit, e->source);
      for (const auto& [verb, what] : e->inputs_and_outputs()) text += fmt::format("  {}: {}\n", verb, what);
      const FilterSettings settings(*e);
      for (const Parameter& p : e->parameters)
        text += fmt::format("  --{:<18} {:<8} {}; {}\n", p.name, Parameter::text(settings.get(p)), p.help, p.range());
      text += "\n";
    }
    print(common.json
              ? nlohmann::json{{"filters", list}}.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n"
              : text);
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app
