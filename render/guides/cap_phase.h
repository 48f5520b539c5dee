#pragma once
#include <algorithm>
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

/// The same for caps of any width.
class CapPhases {
 public:
  explicit CapPhases(const PhaseFunction& phase) {
    for (size_t i = 0; i < kMeanCosines.size(); ++i) caps_[i] = CapPhase(phase, 1 - kMeanCosines[i]);
  }
  /// @param mean_cosine  of the cap's directions to its axis: 0 is the whole sphere
  double value(double cosine, double mean_cosine) const {
    size_t i = 0;
    while (i + 2 < kMeanCosines.size() && mean_cosine > kMeanCosines[i + 1]) ++i;
    const double place = (mean_cosine - kMeanCosines[i]) / (kMeanCosines[i + 1] - kMeanCosines[i]);
    const double wide = caps_[i].value(cosine), narrow = caps_[i + 1].value(cosine);
    return wide + std::clamp(place, 0.0, 1.0) * (narrow - wide);
  }

 private:
  static constexpr std::array<double, 6> kMeanCosines = {0, 0.25, 0.5, 0.75, 0.9, 0.97};
  std::array<CapPhase, kMeanCosines.size()> caps_;
};

}  // namespace brume
