#pragma once
#include <vector>

#include "filters/inputs/planes.h"

namespace brume {

/// A pixel that outshines everything around it.
struct Extreme {
  int x, y;
  double factor;  ///< that brings it down to the level of its surroundings
  bool kept;      ///< it is real: the filter is not to see it, but it stays in the picture
};

/// Whether bright samples that are noise may well meet in a pixel, one in each half: where `in_one` of the pixels
/// around it are as bright in one half alone, (in_one / (2 pixels))^2 * pixels of these are so in both.
bool meet_by_chance(int in_one, int pixels);

/// Finds them in a signal. A pixel is extreme where its luminance is more than K times the mean of the 21 x 21 pixels
/// around it (without the brightest twentieth) plus the median of the frame's lit pixels, and where fewer than half of
/// the 5 x 5 pixels around it have a quarter of it. K is 100 / sqrt(samples per pixel), at least 10: the noise of paths
/// stays below it but for the strongest forward scattering (docs/methods.md). It is real where both half images show
/// it and too few pixels around (of the frame, where guides do not predict it) are as bright in one half alone for two
/// of these to meet by chance, without halves where another of the 5 x 5 has half of it: a lamp, a star. Otherwise it
/// is one sample, and only extreme if it is also more than K times what the guides predict there.
std::vector<Extreme> find_extremes(const Layers& frame, const LayerName& signal, const Task& task);

/// What was done about them.
struct Extremes {
  size_t limited = 0, kept = 0;  ///< pixels
  double taken = 0, lost = 0;    ///< luminance that was taken from the limited ones, and not given back
  Rgb aside;                     ///< to be added to the filtered picture; empty where no pixel is kept
};

/// Keeps single pixels from deciding about their whole neighbourhood, in any filter. One sample is brought down to the
/// level of its surroundings. What it loses goes to its neighbourhood (Gaussian, 32 px) in proportion to the light
/// there, each colour by itself, but a single pixel adds no more than 3 % to it, or than the guides' prediction says is
/// missing there; the rest is lost. What is real is
/// brought down for the filter, too, and `aside` holds what is to be put back. The signal's mean, halves, buckets and
/// variance change alike.
Extremes limit_extremes(Layers& frame, const LayerName& signal, const std::vector<Extreme>& found, const Task& task);

}  // namespace brume
