#pragma once
#include <string>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// Whether a picture's header says that it is OpenEXR's cube map (envmap = cube).
bool is_cube_map(const Layers& picture);

/// The lat-long picture of a cube map, four times as wide and twice as high as a face: +Y is up, +Z in the middle, +X
/// left of it, as in OpenEXR's own lat-long pictures. Each pixel is the mean of 4 x 4 bilinear look-ups. The cube has
/// its six faces +X, -X, +Y, -Y, +Z, -Z below each other, and pixels on its edges lie on the edges.
/// @param name  of the file, for messages   @throws InputError: another shape; Interrupted
/// Source: OpenEXR, ImfEnvmap.h
Layers lat_long_of_cube(const Layers& cube, const std::string& name, const Task& task = {});

}  // namespace brume
