#pragma once
#include <array>
#include <cstddef>

#include "base/running_statistics.h"

namespace brume {

/// Running statistics of a pixel's channels: mean, variance of the mean and two half means. Double throughout, so a
/// million samples lose nothing.
template <size_t N>
struct PixelStatistics {
  uint64_t count = 0;
  std::array<uint64_t, 2> half_count{};
  std::array<double, N> mean{}, m2{};
  std::array<std::array<double, N>, 2> half_sum{};

  /// @param half  which half image the sample belongs to: its index's parity
  void add(const std::array<double, N>& x, size_t half) {
    const double inverse = 1.0 / static_cast<double>(++count);
    ++half_count[half];
    for (size_t i = 0; i < N; ++i) {
      const double delta = x[i] - mean[i];
      mean[i] += delta * inverse;
      m2[i] += delta * (x[i] - mean[i]);
      half_sum[half][i] += x[i];
    }
  }
  double mean_variance(size_t i) const {
    return count > 1 ? m2[i] / (static_cast<double>(count) * static_cast<double>(count - 1)) : 0.0;
  }
  double half_mean(size_t half, size_t i) const {
    return half_count[half] ? half_sum[half][i] / static_cast<double>(half_count[half]) : 0.0;
  }
};

}  // namespace brume
