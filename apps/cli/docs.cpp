#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/describe.h"
#include "base/text.h"
#include "evaluate/protocol/command_filter.h"
#include "filters/api/registry.h"
#include "own_filters_md_in.h"
#include "render/scene/scene_reference.h"
#include "workflows/experiment_file.h"

namespace brume::app {
namespace {

/// How to compare a filter of one's own: a command, a function of Python, a file of C++. A test runs its examples.
std::string own_filters() {
  std::string places;
  for (const CommandPlace& place : command_places())
    places += fmt::format("| `{{{}}}` | {} |\n", place.name, place.meaning);
  return replaced(std::string(embedded::own_filters_md_in), "@PLACES@", places);
}

struct Page {
  const char *name, *what;
  std::function<std::string(const CLI::App&)> text;
};

const std::vector<Page>& pages() {
  static const std::vector<Page> list = {
      {"scene", "every key of a scene file, as Markdown", [](const CLI::App&) { return scene_reference(); }},
      {"experiment", "every key of an experiment, as Markdown", [](const CLI::App&) { return experiment_reference(); }},
      {"filters", "every filter and its parameters, as Markdown",
       [](const CLI::App&) { return filters_reference(own_filters()); }},
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
  const Verb command =
      add_command(app, common, "docs", "print a reference page, the manual page, or completions for a shell");
  std::vector<std::string> names;
  for (const Page& page : pages()) names.emplace_back(page.name);
  command("page", *chosen, "which one; without it, what there is")->check(CLI::IsMember(names));
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
