#pragma once
#include <array>

#include "volume/phase_function.h"

namespace brume {

/// A phase function averaged over a cap around each direction, as light has it that is known for a few directions only:
/// a narrow forward peak that falls between two of them is not lost.
class CapPhase {
 public:
  CapPhase() = default;
  /// @param share  of the sphere that the cap covers
  CapPhase(const PhaseFunction& phase, double share);
  double value(double cosine) const {
    const double place = (1 - cosine) * (0.5 * kCells), clamped = place < 0 ? 0 : place > kCells ? kCells : place;
    const int cell = clamped < kCells ? static_cast<int>(clamped) : kCells - 1;
    const auto i = static_cast<size_t>(cell);
    return mean_[i] + (clamped - cell) * (mean_[i + 1] - mean_[i]);
  }

 private:
  static constexpr int kCells = 128;
  std::array<double, kCells + 1> mean_{};  // evenly in the cosine, forwards first
};

}  // namespace brume
