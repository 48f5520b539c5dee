#pragma once
#include <span>

namespace brume {

// The width of a kernel whose squared bias and variance are least together, from what a few widths showed at a pixel.

/// What was tried there.
struct WidthTrials {
  std::span<const double> widths, biases, variances;  ///< of the pixel's mean
  double samples;                                     ///< that the mean is made of
};

/// bias = b0 + b1 a^2, samples * variance = v0 + v1 / a^2, for a kernel over the picture's plane.
/// As published, b0 is left out of the optimum.
/// Source: the Sobel and guided image filter paper, section 5.1
double best_pixel_width(const WidthTrials& trials, double smallest, double largest);

/// bias = b0 + b1 h^2, samples * variance = v0 + v1 / h^dimensions, for a local line in that many dimensions.
/// @param light  brightness of the pixel: a bias is told from none against it
/// Source: Moon, Carr, Yoon 2014, section 5
double best_bandwidth(const WidthTrials& trials, int dimensions, double light, double smallest, double largest);

}  // namespace brume
