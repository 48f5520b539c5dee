#pragma once
#include <optional>
#include <string>

#include "filters/inputs/planes.h"

namespace brume {

/// The version of the Open Image Denoise library that brume is built with; empty: it is built without.
std::string oidn_library_version();

/// What the library has to clean.
struct OidnPicture {
  RgbPlanes color;
  std::optional<RgbPlanes> albedo, normal;
  bool prefilter = false;  ///< cleans albedo and normal first
  int quality = 0;         ///< 0: high, 1: balanced, 2: fast
};

/// The clean picture, by the library with the weights that it holds, on the processor.
Rgb denoise_by_library(const OidnPicture& picture, const Task& task);

}  // namespace brume
