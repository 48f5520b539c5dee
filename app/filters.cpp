#include <fmt/format.h>

#include "app/command.h"
#include "filters/registry.h"
#include "work/filters_json.h"

namespace brume::app {

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
    std::string text;
    for (const FilterEntry* e : entries) {
      text += fmt::format(
          "{}\n  {}\n  take it {}\n  worth {:.3g} times the samples on media at its defaults\n  source: {}\n", e->name,
          e->summary, e->when, e->merit, e->source);
      for (const auto& [verb, what] : e->inputs_and_outputs()) text += fmt::format("  {}: {}\n", verb, what);
      const FilterSettings settings(*e);
      for (const Parameter& p : e->parameters)
        text += fmt::format("  --{:<18} {:<8} {}; {}\n", p.name, Parameter::text(settings.get(p)), p.help, p.range());
      text += "\n";
    }
    print(common.json ? filters_json(entries) + "\n" : text);
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app
