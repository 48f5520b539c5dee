#pragma once
#include <cstddef>

namespace brume::kernels {

/// Chi-square distance of histograms of two pixels, summed over the bins that hold more than one count together, for
/// `count` pairs: sum[x] = sum_b (r h1 - h2 / r)^2 / (h1 + h2) with r = sqrt(n2 / n1), and the number of those bins.
/// Bins are `bin_stride` floats apart.
/// Source: Delbracio et al. 2014, Boosting Monte Carlo rendering by ray histogram fusion, equation 2.
void histogram_distance_row(const float* h1, const float* h2, const float* n1, const float* n2, int bins,
                            size_t bin_stride, int count, float* sum, float* counted);

}  // namespace brume::kernels
