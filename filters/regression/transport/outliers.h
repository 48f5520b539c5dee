#pragma once
#include "filters/regression/transport/input.h"

namespace brume {

/// Of fits to the whole frame.
inline constexpr double kGlobalRidge = 1e-4;

/// Half images whose outliers are drawn in, and what was taken from their mean: `taken` belongs to the neighbourhood,
/// `points`, which both halves show, to where it was.
struct ClampedHalves {
  Rgb a, b, taken, points;
};

/// Draws what lies far above a first fit of all columns in to `limit` deviations from it, in every input: the result is
/// what is `left` of it to explain. Standardises the columns, and weighs by the guides' brightness.
///
/// Deviations are those of the neighbourhood, relative to the fit, themselves robust. Points are drawn in, too: no fit
/// explains them, and one that is bright enough would make all of its neighbourhood seem unexplained. Frames without
/// halves get two pictures in their place, of the pixels of one colour of a chessboard each.
/// @param power    pixels weigh as their brightness to minus this power
/// @param blurred  whether only surfaces can show points: a medium scatters light into all of its neighbourhood
/// @return  of the frame to clean
ClampedHalves draw_outliers_in(RegressionInputs& inputs, float power, double limit, bool blurred, const Task& task);

/// Returns light to the neighbourhood it was taken from, in proportion to the picture.
void redistribute_energy(const Rgb& taken, Rgb& picture, const Plane& mask, const Task& task);

/// Keeps a picture near what the guides expect and the data show: not below a tenth of the smaller of what is expected
/// at a pixel and the least of 3 x 3 pixels of the data, and not below 0. Beside what is much brighter, as a beam near
/// its lamp, fits of wide windows go beyond.
/// @param from_above  whether also not above ten times what is expected and shown at a pixel, where the guides explain
///                    at least half of what 5 x 5 pixels show
void keep_within_known(const RgbPlanes& data, const Rgb& expected, const Plane& mask, bool from_above, Rgb& picture,
                       const Task& task);

/// Keeps surfaces within the values of the 3 x 3 pixels around them: without halves nothing tells what edges of bright
/// highlights make of a fit.
void keep_within_neighbours(const RgbPlanes& data, const Plane& solid, Rgb& picture, const Task& task);

}  // namespace brume
