#pragma once
#include <optional>
#include <vector>

#include "filters/regression/transport/input.h"
#include "filters/regression/transport/stored_pair.h"

namespace brume {

/// What a cascade of fits is made of.
struct CascadeSettings {
  double window;                  ///< deviation of the widest of its Gaussian windows but the frame [px]
  double ridge, ridge_per_pixel;  ///< pull of scaled coefficients towards 0, and the same over the pixels of a window
  float power;                    ///< pixels weigh as their brightness to minus this power
  bool narrow_shapes = true;      ///< whether shapes are fitted in the narrowest window, too
};

/// Fits of the frame to clean: first what is predicted, then wide windows with many columns, and narrower and narrower
/// ones with fewer, each to what the one before leaves. Lets go of the frames nearby.
/// @param over_frames  is given, where there are frames nearby, the fits and the mean over all frames of what theirs
/// miss
/// @return the sum of the fits after each
std::vector<StoredPair> cascade(RegressionInputs& inputs, const CascadeSettings& settings,
                                std::optional<HalfPair>& over_frames, const Task& task);

}  // namespace brume
