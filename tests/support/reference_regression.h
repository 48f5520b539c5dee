#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "image/layers.h"

namespace brume::test {

/// A number, three, or six for each pixel, row by row.
using Values = Eigen::ArrayXd;
using Colours = std::array<Values, 3>;
using Halves = std::array<Colours, 2>;

/// The definition of what transport_regression fits (docs/transport_regression.md): in double precision, every window
/// summed pixel by pixel, and nothing shared with the filter.
struct ReferenceRegression {
  Values mask;                     ///< 1 where pixels are cleaned
  Halves data;                     ///< outliers drawn in
  std::vector<Halves> candidates;  ///< the prediction, the fits of the cascade, and the data
  Halves stacked;                  ///< what stacking makes of them
};

/// @param frame  small, with guides and halves   @param signal  direct or indirect
ReferenceRegression reference_regression(const Layers& frame, const LayerName& signal);

}  // namespace brume::test
