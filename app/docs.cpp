#include "app/command.h"
#include "app/describe.h"
#include "app/experiment_file.h"
#include "filters/registry.h"
#include "render/scene/scene_reference.h"

namespace brume::app {

void add_docs(CLI::App& app, Common& common, Commands& commands) {
  static std::string page;
  CLI::App* command =
      add_command(app, common, "docs", "print a reference page, the manual page, or completions for a shell");
  command
      ->add_option(
          "page", page,
          "scene, experiment or filters, as Markdown; man, as troff; bash, zsh or fish: what that shell completes by")
      ->required()
      ->check(CLI::IsMember({"scene", "experiment", "filters", "man", "bash", "zsh", "fish"}));
  commands[command] = [&app] {
    print(page == "scene"        ? scene_reference()
          : page == "experiment" ? experiment_reference()
          : page == "filters"    ? filters_reference()
          : page == "man"        ? man_page(app)
                                 : completions(app, page));
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app
