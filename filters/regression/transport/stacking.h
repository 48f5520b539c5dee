#pragma once
#include "filters/regression/transport/stored_pair.h"

namespace brume {

struct StackingWindow {
  double deviation;  ///< of the Gaussian over which weights are chosen [px]
  double caution;    ///< pull towards the frame's own weights, in effective pixels
  double doubt = 0;  ///< standard errors that any other must gain over the first candidate, which has no noise
};

/// Non-negative weights with sum one for every pixel and candidate, which minimise the squared error that each half's
/// candidates have against the other half, in smooth windows of a lattice; the errors' covariances are corrected for
/// the mean of both halves being used, which has half the noise of one.
/// Source: Wolpert 1992, Stacked generalization; Breiman 1996, Stacked regressions.
/// @param weight  of each pixel, >= 0
/// @param data  the halves, which are the last candidate themselves
std::vector<Plane> stacking_weights(const std::vector<StoredPair>& candidates, const HalfPair& data,
                                    const Plane& weight, const StackingWindow& window, const Task& task);

/// The weights pi >= 0, sum pi = 1, that minimise pi^T D pi; D symmetric, row by row.
std::vector<double> simplex_minimum(const std::vector<double>& quadratic, const std::vector<double>& start);

}  // namespace brume
