#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// Whether a file begins as Radiance HDR pictures do.
bool is_hdr(const std::filesystem::path& path);

/// Reads a Radiance HDR picture (RGBE) into layer::beauty, rows from the top whatever their order in the file. A value
/// is mantissa * 2^(exponent - 136), 0 where the exponent is 0, divided by all EXPOSURE and COLORCORR lines: radiance
/// as it was before a picture was made lighter or darker. PRIMARIES stand in the header as chromaticities; without them
/// the colours are Rec. 709, as most programs write them. Scan lines may be flat, or run-length encoded in the old or
/// the new way.
/// @param notes  where to add what was divided out; null: not collected
/// @throws InputError: missing, another format, XYZE, an exposure that is no positive number, damaged or truncated
/// (says
///         at which row); Interrupted
/// Source: Radiance's reference manual, file formats; Ward 1991, Real Pixels.
Layers read_hdr(const std::filesystem::path& path, const Task& task = {}, std::vector<std::string>* notes = nullptr);

}  // namespace brume
