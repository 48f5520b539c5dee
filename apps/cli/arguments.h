#pragma once
#include <string>
#include <vector>

#include "apps/cli/cli11.h"

namespace brume::app {

/// The words of a command line with what CLI11 cannot place put in its place:
///
/// - `-f NAME --radius 3` becomes `-f NAME:radius=3`, wherever the verb has a --filter and no option --radius: what
///   follows a filter belongs to it. Parameters before the first -f go to every filter.
/// - `--tev scene.toml` becomes `--tev=default scene.toml`: the address may be left out, a scene is none.
///
/// @throws InputError for an option that the verb does not have, naming the nearest, for a parameter without its value
///         or without a filter
std::vector<std::string> arrange(const CLI::App& app, const std::vector<std::string>& words);

/// Lets every integer option of every verb take its number as decimal, leading zeros or not; CLI11 takes 010 for octal.
void read_integers_as_decimal(CLI::App& app);

}  // namespace brume::app
