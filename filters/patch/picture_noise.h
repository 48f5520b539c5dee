#pragma once
#include "filters/inputs/planes.h"

namespace brume {

/// How much noise a picture carries at each pixel, from the picture alone, taken to be independent from pixel to pixel:
/// what neither straight lines through the pixel nor pixels in surroundings like its own can say of it. Variance of
/// each channel, above 0. The smaller of two means over 9 x 9 pixels:
/// - of products of two second differences at right angles, which share nothing but the pixel's own noise, so that an
///   edge along either leaves them as they are; of four pairs of directions the least; and of squared differences of
///   order 2, 4 and 6 along both axes, where these are clearly less
/// - of squared differences to the mean of pixels whose 3 x 3 surroundings, without the pixels themselves, are alike,
///   as text, grids and weaves repeat themselves; what noise that mean has itself is taken off
/// Of this what is texture by its growth from octave to octave is taken off (texture_share.h).
/// In either, values far above the others of 21 x 21 pixels are cut, because single bright points may be stars.
/// Sources: Immerkaer 1996, Fast noise variance estimation, for differences along both axes; Laine et al. 2019,
/// High-quality self-supervised deep image denoising, for leaving the pixel itself out.
Rgb picture_variance(const RgbPlanes& picture, const Task& task);

/// Takes a variance for stated wrongly where it is above all that pixels differ by from the mean of the 9 x 9 around
/// them, over 33 x 33 pixels and all colours, and a fifth more: files hold variances that mean something else. Where
/// twice as much is stated the picture alone decides, by what varies from each pixel to the next and is no texture.
/// Noise that a pixel filter has spread over neighbours keeps its variance, though it varies less from one to the next.
void limit_variance(Rgb& variance, const RgbPlanes& picture, const Task& task);

}  // namespace brume
