#pragma once
#include "filters/patch/neighbourhood.h"

namespace brume {

/// A frame as the windows around the pixels of the frame to clean see it.
struct RegressionFrame {
  WeightModel model;  ///< how pixels of the frame to clean compare with this one's
  std::vector<const Plane*> features, values;
};

/// Weighted linear regression around every pixel p on position and features, whose predictions for all pixels of the
/// window are averaged ("collaborative"): minimises sum_q w_pq |v_q - b^T (1, q - p, f_q - f_p)|^2 and returns
/// sum_p w_pq b_p^T (1, q - p, f_q - f_p) / sum_p w_pq at every pixel q, where each prediction is kept within the
/// values of its window: a line that one bright sample tilts would lead far below black beside it. Source: Bitterli et
/// al. 2016, Nonlinearly Weighted First-order Regression, section 4.
/// @param frames  the frame to clean, then others of the sequence, whose pixels lines are fitted to as well;
/// predictions
///                are those for the frame to clean
/// @param wanted  null: all; else lines are fitted near the pixels above 0 alone, and what no line reaches is 0
std::vector<Plane> collaborative_regression(std::span<const RegressionFrame> frames, int radius, const Task& task,
                                            const Plane* wanted = nullptr);

}  // namespace brume
