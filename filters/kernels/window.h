#pragma once
#include <span>

#include "filters/kernels/work_image.h"

namespace brume::kernels {

// Weighted averages over a square window, out(p) = sum w(p, q) v(q) / sum w(p, q), clipped to the image and
// renormalised. The weights' scalar definitions are in reference.h; these are the same sums in vectors along x, for
// every instruction set, chosen at run time. A row depends on nothing but the inputs, so threads may take any rows.

/// exp(-r^2 / (2 sigma^2)) in the two forms that bilateral weights need. A sigma <= 0 switches its term off.
struct Bilateral {
  float sigma_domain = 2, sigma_range = 20;
};

struct WindowInput {
  int radius = 6;
  const WorkImage* guide = nullptr;   ///< one or three channels: what the range kernel compares
  const WorkImage* values = nullptr;  ///< three or four channels: what is averaged; may be the guide itself
  WorkImage* out = nullptr;           ///< as many channels as values
  /// Coverage: pixels at 0 are background. Null: there is none.
  const PaddedPlane* medium = nullptr;
  enum class Background { kBilateral, kCopy } background = Background::kBilateral;
  Bilateral background_weights;  ///< the gradient-kernel paper's 2 and 20
};

/// Copies `image`, but for the background's pixels: for filters that do not run through a window themselves.
void background_row(const WindowInput& in, const WorkImage& image, int y);

/// w = w_D w_L.
void bilateral_row(const WindowInput& in, const Bilateral& weights, int y);

/// The range kernel centred on `prefiltered` instead of the pixel itself; where no neighbour is near it, the result is
/// the prefiltered value. Channels of `prefiltered`: those of the guide, then those of the values if they differ.
void extended_bilateral_row(const WindowInput& in, const Bilateral& weights, const WorkImage& prefiltered, int y);

/// How the gradient kernel w_G joins the others.
enum class GradientVariant { kAdd, kMultiply, kGate };

struct GradientWeights {
  Bilateral bilateral;
  float sigma_gradient = 3;
  GradientVariant variant = GradientVariant::kAdd;
  float gate_strength = 1;  ///< gamma of the gate
  float sigma_opacity = 0.1f;
};

/// Add: w_D (w_L + w_G).  Multiply: w_D w_L w_G.  Gate: w_D (w_L + gamma w_G w_A), w_A comparing opacity.
/// @param gradient  unit x, y, z and a fourth channel that is 1 where the direction is defined, else 0. Between two
/// pixels
///                  of which one is undefined w_G = 0; a pixel whose own is undefined gets w_D w_L in every variant
/// @param opacity   for the gate only
/// @param nearby    other frames, whose windows at the same place count as well
struct GradientSlice {
  const WorkImage *guide, *values, *gradient;
  const PaddedPlane* opacity;
};
void gradient_kernel_row(const WindowInput& in, const GradientWeights& weights, const WorkImage& gradient,
                         const PaddedPlane* opacity, int y, std::span<const GradientSlice> nearby = {});

struct TrilateralWeights {
  Bilateral bilateral;
  float sigma_impulse = 40, sigma_joint = 50;
};

/// ROAD_4: the sum of the four smallest distances to the eight neighbours, borders repeated.
void road_row(const WorkImage& guide, PaddedPlane& road, int y);

/// w = w_S w_R^(1 - J) w_I^J.
void trilateral_row(const WindowInput& in, const TrilateralWeights& weights, const PaddedPlane& road, int y);

/// One direction of a separable Gaussian with a window of `radius`; sigma <= 0 is a box.
void gaussian_horizontal_row(const WorkImage& in, WorkImage& out, int radius, float sigma, int y);
void gaussian_vertical_row(const WorkImage& in, WorkImage& out, int radius, float sigma, int y);

}  // namespace brume::kernels
