#pragma once
#include <cstddef>

namespace brume::kernels {

/// Channels that lie side by side for each pixel: a block.
inline constexpr int kBlock = 16;
/// Pixels beyond the last one that convolve_row() may read and write.
inline constexpr int kBeyond = 13;

/// What a tap of a convolution adds to a row of pixels: that of pixel i reads `inputs` channels, one after another, at
/// `input + i * step`.
struct Tap {
  const float* input;
  ptrdiff_t step;
  const float* weights;  ///< of the first block: kBlock outputs for each input
  int inputs;
};

/// A row of pixels that a convolution makes.
struct ConvolvedRow {
  const Tap* taps;
  size_t count;
  const float* bias;
  float* out;
  ptrdiff_t step;                        ///< floats from one pixel's outputs to the next one's
  int blocks;                            ///< of outputs
  ptrdiff_t out_stride, weights_stride;  ///< floats to the next block: of outputs, of a tap's weights
  int pixels;
  float lowest;  ///< results are not below this
};

/// out[o] of pixel i = bias[o] + sum over the taps t and their inputs c of t.input[i * t.step + c] *
/// t.weights[c * kBlock + o], added in this order: a pixel does not depend on which others are computed with it.
void convolve_row(const ConvolvedRow& row);

}  // namespace brume::kernels
