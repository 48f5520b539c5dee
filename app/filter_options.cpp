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

void OutlierOption::add_to(CLI::App& command) {
  command
      .add_option("--outliers", text,
                  "what the filter gets of fireflies: extreme limits single samples that outshine everything around "
                  "them and returns their light nearby, as far as it is not seen; clamp limits all that stand out of "
                  "their noise, their light being lost, redistribute moves it to their neighbours; keep: all of them")
      ->check(CLI::IsMember({"extreme", "clamp", "redistribute", "keep"}))
      ->capture_default_str();
}

Outliers OutlierOption::chosen() const {
  return text == "clamp"          ? Outliers::kClamp
         : text == "redistribute" ? Outliers::kRedistribute
         : text == "keep"         ? Outliers::kKeep
                                  : Outliers::kExtreme;
}

}  // namespace brume::app
