#pragma once
#include <cstddef>
#include <cstdint>

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

  /// Means of all values over the n samples of every step-th group. 0 without samples.
  void means(const double* state, size_t first_group, size_t step, uint64_t n, double* result) const;
  /// Variances of the means over all n samples: sample variance / n. 0 with fewer than two.
  void mean_variances(const double* state, uint64_t n, double* result) const;

 private:
  // Adds x to high + low without error (Knuth's two-sum), and normalises: what add() does with vectors, bit for bit.
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
