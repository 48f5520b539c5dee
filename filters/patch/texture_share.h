#pragma once
#include "filters/inputs/planes.h"

namespace brume {

/// How much of what varies from pixel to pixel is noise for sure: in [0, 1], 1 where nothing speaks of texture.
///
/// Noise of independent pixels has the same density in every octave of frequencies, texture the more of it the coarser
/// the octave. Densities are measured in the finest octave (the `variance` asked about) and in the next two; the growth
/// between these says, by a power law, what texture has in the finest. More than twice as much is taken off, as
/// texture follows no law exactly, and of all solutions the one of the least noise counts: noise left in a picture is
/// no loss against that picture, texture taken from it is. Where densities grow more than twelvefold from octave to
/// octave the picture is smooth, and has less in the finest than any power law.
/// @param variance  of the picture's noise and of what looks like it, per channel
Plane share_of_noise(const Rgb& variance, const RgbPlanes& picture, const Task& task);

}  // namespace brume
