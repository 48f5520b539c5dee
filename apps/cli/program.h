#pragma once
#include <optional>
#include <string>
#include <vector>

namespace brume::app {

/// Runs a program from the path to its end, without input or output.
/// @return its exit status; nothing where there is no such program
std::optional<int> run_program(const std::vector<std::string>& words);

}  // namespace brume::app
