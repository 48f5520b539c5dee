#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/describe.h"
#include "filters/api/registry.h"
#include "render/scene/scene_reference.h"
#include "workflows/experiment_file.h"
#include "workflows/own_filters.h"

namespace brume::app {
namespace {

struct Page {
  const char *name, *what;
  std::function<std::string(const CLI::App&)> text;
};

const std::vector<Page>& pages() {
  static const std::vector<Page> list = {
      {"scene", "every key of a scene file, as Markdown", [](const CLI::App&) { return scene_reference(); }},
      {"experiment", "every key of an experiment, as Markdown", [](const CLI::App&) { return experiment_reference(); }},
      {"filters", "every filter and its parameters, as Markdown",
       [](const CLI::App&) { return filters_reference(own_filters_reference()); }},
      {"man", "the manual page, as troff", man_page},
      {"bash", "what bash completes by", [](const CLI::App& app) { return completions(app, "bash"); }},
      {"zsh", "what zsh completes by", [](const CLI::App& app) { return completions(app, "zsh"); }},
      {"fish", "what fish completes by", [](const CLI::App& app) { return completions(app, "fish"); }},
  };
  return list;
}

}  // namespace

void add_docs(CLI::App& app, Common& common, Commands& commands) {
  const auto chosen = std::make_shared<std::string>();
  CLI::App* command =
      add_command(app, common, "docs", "print a reference page, the manual page, or completions for a shell");
  std::vector<std::string> names;
  for (const Page& page : pages()) names.emplace_back(page.name);
  command->add_option("page", *chosen, "which one; without it, what there is")->check(CLI::IsMember(names));
  commands[command] = [chosen, &app] {
    std::string list;
    for (const Page& page : pages()) {
      if (*chosen == page.name) print(page.text(app));
      list += fmt::format("brume docs {:<12}{}\n", page.name, page.what);
    }
    if (chosen->empty()) print(list);
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app
