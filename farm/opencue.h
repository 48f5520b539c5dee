#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "farm/plan.h"

namespace brume {

/// A Python script that launches the plan through OpenCue's outline library: a layer for each stage, a frame of it for
/// each command, each layer after the one before.
/// @param round  folder of the round (write_round)
std::string opencue_outline(const Shot& shot, const std::vector<Stage>& stages, const std::filesystem::path& round);

}  // namespace brume
