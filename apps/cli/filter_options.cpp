#include "apps/cli/filter_options.h"

namespace brume::app {

void add_component_options(const Verb& command, std::string& component, std::string& background) {
  command(
      "--component", component,
      "what to clean: all, the beauty; the indirect layer, direct being added back; or separate, both by themselves")
      ->check(one_of(kComponents))
      ->capture_default_str();
  command(
      "--background", background,
      "pixels without coverage: the bilateral filter, or the filter like the rest; default: bilateral for the filters of the gradient-kernel paper")
      ->check(one_of(kBackgrounds))
      ->capture_default_str();
}

void add_outlier_option(const Verb& command, std::string& outliers) {
  command(
      "--outliers", outliers,
      "what the filter gets of fireflies: extreme limits single samples that outshine everything around them and returns their light nearby, as far as it is not seen; clamp limits all that stand out of their noise, their light being lost, redistribute moves it to their neighbours; keep: all of them")
      ->check(one_of(kOutlierRules))
      ->capture_default_str();
}

}  // namespace brume::app
