#pragma once
#include <filesystem>
#include <string>

#include "base/progress.h"
#include "render/world/volume_files.h"

namespace brume {

/// The grids that glow in a file.
struct Fire {
  std::string temperature, flame;  ///< the one that is used; both empty: nothing burns
  double hottest = 0;              ///< of the temperature, as it is stored
  std::string why_none;            ///< although there is a grid that could be taken for one

  bool burns() const { return !temperature.empty() || !flame.empty(); }
};

/// Looks for fire in a volume's file, in what is said of it or in its usual grids.
/// @throws InputError: as load_scalar
Fire find_fire(const VolumeFile& file, const Said& said, const Task& task);

/// The kelvin of one unit of a temperature, said or guessed.
double kelvin_per_unit(double hottest, const VolumeSettings& volume, const Said& said);

/// Luminance of what a temperature emits at an intensity of 1.
double emitted_luminance(double hottest, const VolumeSettings& volume, const Said& said);

}  // namespace brume
