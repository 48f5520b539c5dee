#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace brume {

/// Sums of a pixel's sampled values that do not depend on the order in which they were taken: each is an unevaluated
/// sum of two doubles, 106 bits wide, and each value is rounded to float first, so that adding loses nothing while the
/// values' binary exponents span less than about 60. Any split of the samples over threads or machines gives the same
/// bits.
///
/// Layout for one pixel, as plain doubles, so that a tile's state can be saved and merged: for each of `groups` sums
/// the high parts of all values, then their low parts; after those, where squares are kept, the same of the squares.
/// Samples go to the group index % groups: 1 for a plain mean, 2 for half images, 8 for bucket means.
class PixelSums {
 public:
  PixelSums(size_t values, size_t groups, bool squares) : values_(values), groups_(groups), squares_(squares) {}

  size_t doubles() const { return 2 * values_ * (groups_ + squares_); }
  size_t values() const { return values_; }
  size_t groups() const { return groups_; }
  bool squares() const { return squares_; }

  /// Adds `count` samples, rows of values() numbers one after the other; the first one's index is `first`.
  void add(double* state, const float* rows, size_t count, size_t first) const;
  void merge(double* state, const double* other) const {
    for (size_t block = 0; block < groups_ + squares_; ++block) {
      const size_t at = 2 * values_ * block;
      for (size_t i = at; i < at + values_; ++i) {
        accumulate(state[i], state[i + values_], other[i]);
        accumulate(state[i], state[i + values_], other[i + values_]);
      }
    }
  }

  /// Mean of a value over the n samples of every step-th group. 0 without samples.
  double mean(const double* state, size_t value, size_t first_group, size_t step, uint64_t n) const {
    double total = 0;
    for (size_t g = first_group; g < groups_; g += step) {
      const double* const high = state + 2 * values_ * g;
      total += high[value] + high[values_ + value];
    }
    return n ? total / static_cast<double>(n) : 0.0;
  }
  /// Variance of the mean over all n samples: sample variance / n. 0 with fewer than two.
  /// @param inverse  1 / n
  double mean_variance(const double* state, size_t value, uint64_t n, long double inverse) const {
    if (n < 2) return 0;
    // The difference of nearly equal numbers: 64 bits are kept.
    const auto whole = [&](const double* high) {
      return static_cast<long double>(high[value]) + high[values_ + value];
    };
    long double total = 0;
    for (size_t g = 0; g < groups_; ++g) total += whole(state + 2 * values_ * g);
    const long double squared = whole(state + 2 * values_ * groups_);
    const long double deviation = squared - total * total * inverse;
    // What is left of equal values is rounding.
    if (!(deviation > 1e-17L * squared)) return 0;
    return static_cast<double>(deviation) / (static_cast<double>(n) * static_cast<double>(n - 1));
  }

 private:
  // Adds x to high + low without error (Knuth's two-sum), and normalises.
  static void accumulate(double& high, double& low, double x) {
    const double s = high + x, b = s - high;
    const double error = (high - (s - b)) + (x - b), l = low + error;
    high = s + l;
    low = l - (high - s);
  }

  size_t values_, groups_;
  bool squares_;
};

}  // namespace brume
