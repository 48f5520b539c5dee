#pragma once
#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// SSIM at each pixel: how alike the structure of two pictures is around it, 1 where they are equal.
///
/// Of the luma (Rec. 601 weights) of the sRGB-encoded pictures in [0, 1], in Gaussian windows of 11 x 11 pixels and a
/// standard deviation of 1.5; the constants are (0.01)^2 and (0.03)^2. The picture's border is mirrored.
/// @param test, reference  linear Rec. 709 times `exposure`, clipped to [0, 1]. Finite, of one size
/// Source: Wang, Bovik, Sheikh, Simoncelli 2004, Image Quality Assessment: From Error Visibility to Structural
/// Similarity.  Proof: tests/evaluate/metric_test.cpp
Plane ssim_map(const RgbPlanes& test, const RgbPlanes& reference, double exposure, const Task& task);

}  // namespace brume
