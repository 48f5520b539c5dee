#include "app/filter_options.h"

namespace brume::app {

void FilterOptions::add_to(CLI::App& command) {
  command
      .add_option("--component", component,
                  "what to clean: all, the beauty; the indirect layer, direct being added back; or both apart")
      ->check(CLI::IsMember({"all", "indirect", "apart"}))
      ->capture_default_str();
  command
      .add_option("--background", background,
                  "pixels without coverage: the bilateral filter, or the filter like the rest; default: bilateral for "
                  "the filters of the gradient-kernel paper")
      ->check(CLI::IsMember({"default", "bilateral", "filter"}))
      ->capture_default_str();
}

Component FilterOptions::chosen_component() const {
  return component == "all" ? Component::kAll : component == "apart" ? Component::kApart : Component::kIndirect;
}

BackgroundRule FilterOptions::chosen_background() const {
  return background == "filter"      ? BackgroundRule::kFilter
         : background == "bilateral" ? BackgroundRule::kBilateral
                                     : BackgroundRule::kDefault;
}

}  // namespace brume::app
