#pragma once
#include <deque>
#include <functional>
#include <vector>

#include "filters/inputs/half_pair.h"
#include "filters/regression/transport/columns.h"

namespace brume {

/// Brightness below this share of the mean counts as that much where a division is at stake.
inline constexpr float kDark = 0.1f;

/// A frame of the sequence, or the one to clean.
struct RegressionInput {
  TransportColumns known;
  float share;  // of its pixels against those of the frame to clean
  bool halves;  // or the whole signal twice
  RgbPlanes half_a, half_b;
  Plane samples;  // of each pixel, relative to the mean; empty: alike
  Plane weight;
  Plane level;    // the brightness that the fits found
  HalfPair left;  // of the halves, outliers drawn in: what no fit explains so far

  RegressionInput(const FilterFrame& frame, const Plane& one, float share_, const Task& task);
  /// Weighs pixels by share * samples / (brightness + a share of its mean)^power within the mask.
  void weigh_by(const Plane& brightness, float power, const Task& task);
};

/// The frame to clean first, then those nearby. They stay where they are: columns point into them.
using RegressionInputs = std::deque<RegressionInput>;

/// @param frames  deviation of the Gaussian over frames
/// @param one     a plane of ones, which stays where it is
/// @throws InputError for a frame with other guides
RegressionInputs inputs_of(float frames, const FilterFrame& frame, const Plane& one, const Task& task);

/// What is fitted, and where.
struct FitStep {
  Fit columns;
  LatticeWindow window;
  size_t free = 0;  ///< so many columns are not shrunk
};

/// What becomes of a fit to an input: its colour c of both halves, of the step's first fit or one of those `then`.
using TakeFit = std::function<void(size_t fit, size_t input, size_t c, Plane a, Plane b)>;

/// Fits both halves of all inputs with the same coefficients, each colour by itself; those with the same columns
/// together.
/// @param halves  what is fitted of an input
void fit(const RegressionInputs& inputs, const FitStep& step,
         const std::function<std::array<RgbPlanes, 2>(const RegressionInput&)>& halves, const TakeFit& take,
         const Task& task);

}  // namespace brume
