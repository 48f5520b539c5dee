#pragma once
#include <filesystem>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// Whether a file begins as Radiance HDR pictures do.
bool is_hdr(const std::filesystem::path& path);

/// Reads a Radiance HDR picture (RGBE, rows from the top: "-Y height +X width") into layer::beauty, in the file's own
/// units: EXPOSURE and COLORCORR lines are not undone. Scan lines may be flat, or run-length encoded in the old or the
/// new way. A value is mantissa * 2^(exponent - 136), 0 where the exponent is 0.
/// @throws InputError: missing, another format, another order of pixels, XYZE, damaged or truncated (says at which
///         row); Interrupted
/// Source: Radiance's reference manual, file formats; Ward 1991, Real Pixels.
Layers read_hdr(const std::filesystem::path& path, const Task& task = {});

}  // namespace brume
