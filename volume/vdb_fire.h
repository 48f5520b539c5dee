#pragma once
#include <filesystem>

#include "volume/vdb_io.h"

namespace brume {

/// The temperature of what burns in a file: the usual grid of temperatures, or a field without voxels and a note where
/// the usual grid of flames holds none; the file then stores what lifts its smoke. One request to the reading process,
/// whose start takes longer than reading a small grid.
/// @throws InputError: as load_scalar; NoSuchGrid where there is no grid of temperatures
ScalarField load_fire_temperature(const std::filesystem::path& path, const ScalarOptions& options,
                                  const Task& task = {});

}  // namespace brume
