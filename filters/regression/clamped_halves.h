#pragma once
#include "filters/patch/selection.h"

namespace brume {

/// Half images whose outliers are drawn in, and what was taken from their mean: `taken` belongs to the neighbourhood,
/// `points`, which both halves show, to where it was.
struct ClampedHalves {
  Rgb a, b, taken, points;
};

/// Draws samples' means that lie far above a first fit to `limit` deviations from it. Deviations are those of the
/// neighbourhood, relative to the fit, themselves robust. Points are drawn in, too: no fit explains them, and one that
/// is bright enough would make all of its neighbourhood seem unexplained.
/// @param level   the fit's brightness
/// @param halves  whether a and b are two halves; else the whole signal twice
ClampedHalves clamp_outliers(const RgbPlanes& a, const RgbPlanes& b, const Rgb& fit, const Plane& level,
                             const Plane& mask, double limit, bool halves, const Task& task);

/// Returns light to the neighbourhood it was taken from, in proportion to the picture.
void redistribute_energy(const Rgb& taken, Rgb& picture, const Plane& mask, const Task& task);

/// Keeps surfaces within the values of the 3 x 3 pixels around them: without halves nothing tells what edges of bright
/// highlights make of a fit.
void keep_within_neighbours(const RgbPlanes& data, const Plane& solid, Rgb& picture, const Task& task);

}  // namespace brume
