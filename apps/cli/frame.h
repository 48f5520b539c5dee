#pragma once
#include <string>
#include <vector>

#include "apps/cli/command.h"
#include "workflows/frame.h"

namespace brume::app {

/// Accepts "header", "auto" or a number above 0.
CLI::Validator exposure_validator();

/// --size WIDTHxHEIGHT, which sets two keys of the scene. After -D, whose values replace all that is in `overrides`.
void add_size_option(const Verb& command, std::vector<std::string>& overrides);

/// --ocio and what belongs to it. @param shown  what is shown, "the PNG is shown"
void add_display_options(const Verb& command, PictureOptions& options, const std::string& shown);

/// --exposure, --tone and those.
void add_picture_options(const Verb& command, PictureOptions& options, const std::string& exposure_help);

}  // namespace brume::app
