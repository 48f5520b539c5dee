#include "app/command.h"
#include "filters/registry.h"
#include "render/scene/scene_reference.h"

namespace brume::app {

void add_docs(CLI::App& app, Common& common, Commands& commands) {
  static std::string page;
  CLI::App* command = add_command(app, common, "docs", "print a reference page, as Markdown");
  command->add_option("page", page, "scene or filters")->required()->check(CLI::IsMember({"scene", "filters"}));
  commands[command] = [] {
    print(page == "scene" ? scene_reference() : filters_reference());
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app
