#pragma once
#include <string>

#include "apps/cli/cli11.h"

namespace brume::app {

// What the declarations of the command line say, for other readers than --help.

/// The manual page brume(1), as troff takes it: every verb with its options, and what is at the foot of its help.
std::string man_page(const CLI::App& app);

/// Completion of verbs, options, their choices and the filters' names for "bash", "zsh" or "fish".
std::string completions(const CLI::App& app, const std::string& shell);

}  // namespace brume::app
