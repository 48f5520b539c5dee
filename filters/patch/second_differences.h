#pragma once
#include <array>

#include "filters/inputs/planes.h"

namespace brume {

/// Times the level of the 21 x 21 values around at which single ones are cut: bright points may be stars. And where
/// only few samples that are far brighter than all others are to be kept from deciding alone.
inline constexpr float kFarAbove = 20, kVeryFarAbove = 200;

/// Means over squares of 2 radius + 1 pixels, of values that are cut `far_above` times their level.
Plane mean_without_peaks(const Plane& values, int radius, const Task& task, float far_above = kFarAbove);

/// An index beyond the ends of 0 .. n - 1, reflected there.
int mirrored(int i, int n);

/// What the pairs of directions of least_product find of white noise of variance 1, one after the other: in a picture
/// as it is, in steps of 1 px; blurred once, of 2; and twice, of 4 (halved_detail).
inline constexpr std::array<float, 4> kWhiteAt1 = {4, 4, 4, 4}, kWhiteAt2 = {0.390625f, 0.53125f, 0.5625f, 0.5625f},
                                      kWhiteAt4 = {0.0705566f, 0.105957f, 0.118164f, 0.118164f};

/// Mean product of two second differences at right angles, over `white`: of four pairs of directions the least. The two
/// share nothing but the pixel in their middle, so that an edge along either leaves them as they are.
/// @param step  of the differences [px]     @param radius  of the mean [px]
Plane least_product(const Plane& picture, int step, const std::array<float, 4>& white, int radius, const Task& task,
                    float far_above = kFarAbove);

/// Weighted mean of 3 x 3 pixels `step` apart, [1 2 1] x [1 2 1] / 16: with steps of 1, then 2, detail of one octave
/// after the other is taken off.
Plane halved_detail(const Plane& picture, int step, const Task& task);

/// Squares of the mask [1 -2 1] x [1 -2 1], which are 1 in the mean where white noise has a variance of 1.
/// Source: Immerkaer 1996, Fast noise variance estimation.
Plane mask_squares(const Plane& picture, const Task& task);

}  // namespace brume
