#pragma once
#include <filesystem>
#include <span>

#include "image/layers.h"

namespace brume {

/// Writes one or three planes of one size as a portable float map: "PF" or "Pf", 32-bit little-endian floats (scale
/// -1.0), rows from the bottom up. The file appears whole or not at all. @throws InputError
void write_pfm(const std::filesystem::path& path, std::span<const Plane* const> planes);

/// Reads one, of either byte order, into layer::beauty or, where it is grey, the channel Y. Values are multiplied by
/// the absolute value of its scale.
/// @throws InputError: missing, no PFM, truncated
Layers read_pfm(const std::filesystem::path& path);

}  // namespace brume
