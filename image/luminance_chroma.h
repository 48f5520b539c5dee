#pragma once
#include <array>

#include "image/plane.h"

namespace brume {

/// A picture as OpenEXR keeps it to save room: luminance Y, and RY = (R - Y) / Y and BY = (B - Y) / Y, which may be
/// subsampled.
struct LuminanceChroma {
  Plane y, ry, by;
};

/// Y = weights . (R, G, B). Where Y is 0 all three are.
/// @param weights  the luminances of red, green and blue, of sum 1
std::array<Plane, 3> rgb_from_luminance_chroma(const LuminanceChroma& picture, const std::array<float, 3>& weights);
LuminanceChroma luminance_chroma_from_rgb(const std::array<const Plane*, 3>& rgb, const std::array<float, 3>& weights);

/// A plane of `width` x `height` pixels from one value at every `step.x`-th column and `step.y`-th row, linear between
/// them and constant after the last.
Plane upsampled(const Plane& coarse, int width, int height, int step_x, int step_y);

/// The values at every step-th column and row, each a tent-weighted mean of the pixels nearer than one step.
Plane downsampled(const Plane& fine, int step_x, int step_y);

/// A plane of another size, each pixel the mean of the area that it covers.
Plane resampled(const Plane& plane, int width, int height);

}  // namespace brume
