#pragma once
#include <cstdint>

namespace brume {

/// Count, mean and sum of squared deviations of a stream of numbers, in one pass and without cancellation.
/// Source: Welford 1962; merge() after Chan, Golub, LeVeque 1979.
struct RunningStatistics {
  uint64_t count = 0;
  double mean = 0, m2 = 0;

  void add(double x) {
    ++count;
    const double delta = x - mean;
    mean += delta / static_cast<double>(count);
    m2 += delta * (x - mean);
  }
  void merge(const RunningStatistics& other) {
    if (other.count == 0) return;
    const double n = static_cast<double>(count), m = static_cast<double>(other.count), delta = other.mean - mean;
    mean += delta * m / (n + m);
    m2 += other.m2 + delta * delta * n * m / (n + m);
    count += other.count;
  }
  /// Of one sample; 0 with fewer than two.
  double sample_variance() const { return count > 1 ? m2 / static_cast<double>(count - 1) : 0.0; }
  /// Of the mean: sample variance / n.
  double mean_variance() const { return count > 1 ? sample_variance() / static_cast<double>(count) : 0.0; }
};

}  // namespace brume
