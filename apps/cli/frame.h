#pragma once
#include <string>

#include "apps/cli/command.h"
#include "workflows/frame.h"

namespace brume::app {

/// Accepts "header", "auto" or a number above 0.
CLI::Validator exposure_validator();

/// --exposure and --tone.
void add_picture_options(const Verb& command, PictureOptions& options, const std::string& exposure_help);

}  // namespace brume::app
