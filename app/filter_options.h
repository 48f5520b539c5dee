#pragma once
#include <CLI/CLI.hpp>

#include "filters/run/apply.h"

namespace brume::app {

/// --component and --background, which denoise and evaluate share with defaults of their own.
struct FilterOptions {
  std::string component, background = "default";

  void add_to(CLI::App& command);
  Component chosen_component() const;
  BackgroundRule chosen_background() const;
};

/// --outliers, which denoise and render share.
struct OutlierOption {
  std::string text = "extreme";

  void add_to(CLI::App& command);
  Outliers chosen() const;
};

}  // namespace brume::app
