#pragma once
#include <functional>
#include <vector>

#include "filters/inputs/guide_layers.h"
#include "filters/inputs/planes.h"

namespace brume {

/// A column of a regression: scale * (values - offset * the first column's values).
struct LatticeColumn {
  ChannelView values;
  float offset = 0, scale = 1;
};

/// Columns free of one another's level and of one scale: each but the first less its weighted projection on the first,
/// and divided by what is left, root mean square. A column of nothing gets scale 0.
std::vector<LatticeColumn> standardised(std::vector<LatticeColumn> columns, const Plane& weight, const Task& task);

/// What is known of each pixel: columns, targets, and how much it counts.
struct LatticePixels {
  std::vector<LatticeColumn> columns;
  std::vector<const Plane*> targets;
  const Plane* weight = nullptr;  ///< >= 0; pixels at 0 get a prediction of 0
};

/// Targets that are explained, each by itself, as sums of columns with coefficients that vary smoothly over the frame.
struct LatticeProblem : LatticePixels {
  size_t free = 1;  ///< so many columns are not shrunk
  /// Other frames with the same coefficients: columns and targets in the same order.
  std::vector<LatticePixels> nearby = {};
};

struct LatticeWindow {
  double deviation = 0;        ///< of the Gaussian window [px]; 0: one window, the frame
  double ridge = 0;            ///< on the scaled columns' correlation matrix
  double ridge_per_pixel = 0;  ///< the same, over the effective number of pixels in the window
  /// Of the frame as one window: such ridges of further fits, each to what the one before leaves.
  std::vector<double> then = {};
};

/// Local linear regression at the price of a few passes: products of columns and targets are added up in blocks of
/// pixels, blurred on the lattice of blocks, solved once per block by a Cholesky factorisation in which the columns
/// that are not free are scaled to unit variance (given the free ones) and shrunk by a ridge; coefficients are smoothed
/// on the lattice and interpolated by quadratic B-splines. The same bits for any number of threads.
/// @param take  is given the predictions for the frames nearby, one frame after another; null: not collected
/// @return  a prediction of each target; then, of each, by the further fits
std::vector<Plane> lattice_regression(
    const LatticeProblem& problem, const LatticeWindow& window, const Task& task,
    const std::function<void(size_t nearby, std::vector<Plane> predictions)>& take = nullptr);

/// Local weighted means: of targets / base where both are summed first.
/// @param window  deviation of a Gaussian [px]
std::vector<Plane> local_ratio(const std::vector<const Plane*>& targets, const Plane& base, const Plane& weight,
                               double window, const Task& task);

}  // namespace brume
