#pragma once
#include <fmt/format.h>

#include <string>

#include "apps/cli/command.h"
#include "workflows/choices.h"

namespace brume::app {

/// Accepts the words of the choices.
template <class Value>
CLI::Validator one_of(const Choices<Value>& choices) {
  return CLI::Validator(
      [&choices](const std::string& text) {
        try {
          choices.of(text);
          return std::string();
        } catch (const InputError&) {
          return fmt::format("{} not in {{{}}}", text, join(choices.names(), ","));
        }
      },
      fmt::format("{{{}}}", join(choices.names(), ",")));
}

/// --component and --background, which denoise and evaluate share with defaults of their own.
void add_component_options(const Verb& command, std::string& component, std::string& background);

/// --outliers, which denoise and render share.
void add_outlier_option(const Verb& command, std::string& outliers);

}  // namespace brume::app
