#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "apps/cli/command.h"
#include "filters/api/registry.h"
#include "workflows/filters_json.h"

namespace brume::app {
namespace {

/// One line for each filter.
std::string table_of(const std::vector<const FilterEntry*>& entries) {
  size_t width = 0;
  for (const FilterEntry* e : entries) width = std::max(width, e->name.size());
  std::string text = fmt::format("{:<{}}  worth  take it\n", "filter", width);
  for (const FilterEntry* e : entries) text += fmt::format("{:<{}}  {:>5.3g}  {}\n", e->name, width, e->merit, e->when);
  return text +
         "worth: how many times the samples would leave as much error, on media at its defaults. brume filters NAME tells\n"
         "all about one: its parameters, layers and source; brume filters --all about each.\n";
}

std::string details_of(const FilterEntry& e) {
  std::string text =
      fmt::format("{}\n  {}\n  take it {}\n  worth {:.3g} times the samples on media at its defaults\n  source: {}\n",
                  e.name, e.summary, e.when, e.merit, e.source);
  for (const auto& [verb, what] : e.inputs_and_outputs()) text += fmt::format("  {}: {}\n", verb, what);
  const FilterSettings settings(e);
  for (const Parameter& p : e.parameters)
    text += fmt::format("  --{:<18} {:<8} {}; {}\n", p.name, Parameter::text(settings.get(p)), p.help, p.range());
  return text + "\n";
}

}  // namespace

void add_filters(CLI::App& app, Common& common, Commands& commands) {
  struct Options {
    std::string name;
    bool all = false;
  };
  const auto options = std::make_shared<Options>();
  const Verb command =
      add_command(app, common, "filters",
                  "the filters, what serves best first: when to take which, their parameters, layers and sources");
  command("name", options->name, "all about this one");
  command("--all", options->all, "all about each of them");
  command("--json", common.json, "as one JSON object");
  commands[command] = [options, &common] {
    const auto& [name, all] = *options;
    std::vector<const FilterEntry*> entries = filters_by_merit();
    if (!name.empty()) entries = {&find_filter(name)};
    std::string text = common.json ? filters_json(entries) + "\n" : name.empty() && !all ? table_of(entries) : "";
    if (text.empty())
      for (const FilterEntry* e : entries) text += details_of(*e);
    print(text);
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app
