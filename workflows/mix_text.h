#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "workflows/mix_lights.h"

namespace brume {

// A mix of light groups as text: in a file, and on a command line.

/// A file with a table `mix`: `key = 2`, `fill = [1, 0.8, 0.6]`. @throws InputError that underlines what is wrong
LightMix read_mix(const std::filesystem::path& path);

/// What read_mix() reads.
std::string toml_of_mix(const LightMix& mix);

/// What says it to `brume mix`: "--gain", "key=2", "--colour", "fill=1,0.8,0.6".
std::vector<std::string> words_of_mix(const LightMix& mix);

}  // namespace brume
