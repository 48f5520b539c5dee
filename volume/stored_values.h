#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "volume/vdb_io.h"

namespace brume {

// What the values of a volume count as, wherever they come from: a file's grid or an array.

/// Smaller values are denormal in single precision, which resolves them badly or not at all: they count as 0.
constexpr float kLeastDensity = std::numeric_limits<float>::min();

/// What the stored values of a scalar grid are like.
struct ValueScan {
  double minimum = std::numeric_limits<double>::infinity(), maximum = -minimum;  // of the finite ones
  uint64_t nans = 0, infinities = 0, negatives = 0;
  uint64_t minus_infinities = 0;  // of the infinities
  uint64_t denormals = 0;         // positive ones

  void add(double v, uint64_t count = 1) {
    if (std::isnan(v))
      nans += count;
    else if (std::isinf(v)) {
      infinities += count;
      minus_infinities += v < 0 ? count : 0;
    } else {
      negatives += v < 0 ? count : 0;
      denormals += v > 0 && v < kLeastDensity ? count : 0;
      minimum = std::min(minimum, v);
      maximum = std::max(maximum, v);
    }
  }
  void add(const ValueScan& other);
  void write(GridSummary& summary) const;
};

/// What a stored value of a density counts as: 0 where it is NaN, negative or denormal, the largest finite value of its
/// grid where it is infinite; then what the curve of ScalarOptions makes of it, up to their limit.
class DensityRule {
 public:
  /// @param largest  finite value of the grid
  DensityRule(const ScalarOptions& options, double largest);

  float operator()(double v) const { return std::min(unlimited(v), limit_); }
  /// Whether the limit lowers it.
  bool limits(double v) const { return unlimited(v) > limit_; }
  float limit() const { return limit_; }
  float largest() const { return largest_; }
  bool remaps() const { return !remap_.empty(); }

 private:
  float unlimited(double v) const {
    if (std::isinf(v)) v = v > 0 ? largest_ : 0.0;
    if (!remap_.empty() && v > 0) v = remapped(v);
    if (!(v >= kLeastDensity)) return 0.0f;  // or NaN
    return std::min(static_cast<float>(v), std::numeric_limits<float>::max());
  }
  double remapped(double v) const;

  std::vector<std::pair<double, double>> remap_;
  float largest_, limit_;
};

/// A line for each kind of value that was replaced: NaN, infinite, negative, denormal.
std::vector<std::string> notes_of_values(const GridSummary& summary, float largest);
std::string note_of_limited(const GridSummary& summary, uint64_t voxels, double limit);

/// Colours and velocities that are not finite are 0.
inline float finite_or_zero(double v) {
  return std::isfinite(v) ? static_cast<float>(v) : 0.0f;
}

}  // namespace brume
