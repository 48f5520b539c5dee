#pragma once
#include <filesystem>

#include "base/progress.h"
#include "image/deep_picture.h"

namespace brume {

/// Reads the deep part of a file: scan lines or tiles (of tiles that have several levels the first).
/// @throws InputError: missing, not an EXR, truncated, no deep part or several, depths that are not finite, or that end
///         before they begin; colours and alphas that are not finite, alphas outside of 0 .. 1
DeepPicture read_deep_exr(const std::filesystem::path& path, const Task& task = {});

/// Writes deep scan lines, each packed by itself (ZIPS). The file appears whole or not at all. @throws InputError
void write_deep_exr(const std::filesystem::path& path, const DeepPicture& picture, const Task& task = {});

/// Whether all parts of an EXR are deep, or one of them is; false where it is no EXR that can be read.
bool has_deep_part(const std::filesystem::path& path);

}  // namespace brume
