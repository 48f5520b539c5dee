#pragma once
#include <cstddef>
#include <span>

namespace brume::kernels {

/// One component of a sample's record that counts in the distance, and by how much: its difference is multiplied by
/// `scale` before it is squared.
struct ScaledComponent {
  int index;
  float scale;
};

/// Filters up to 16 samples of a pixel over a neighbourhood of samples (random parameter filtering):
/// w_ij = exp(-sum_k (scale_k (x_ik - x_jk))^2), sums over j of w and w * color_j.
/// @param own     records of the pixel's samples, `count` <= 16
/// @param others  records and colours (three floats) of the neighbourhood
/// @param sums    weight, r, g, b: rows of 16
void filter_samples(std::span<const float* const> own, std::span<const float* const> others,
                    std::span<const float* const> colors, std::span<const ScaledComponent> components,
                    float (*sums)[16]);

}  // namespace brume::kernels
