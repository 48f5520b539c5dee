#pragma once
#include <filesystem>
#include <string>

namespace brume {

/// What to say of a file that is not there, behind its name and a colon: "no such file", and where there is something
/// that may have been meant, what: the nearest name in its folder, the frames that are there of a name with a frame's
/// number in it, or the folder that is missing.
std::string missing_file(const std::filesystem::path& path);

/// @throws InputError with the name and missing_file where nothing has this name
void check_exists(const std::filesystem::path& path);

}  // namespace brume
