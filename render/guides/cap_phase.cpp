#include "render/guides/cap_phase.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

namespace brume {

CapPhase::CapPhase(const PhaseFunction& phase, double share) {
  constexpr int kRings = 12, kTurns = 24;
  for (int cell = 0; cell <= kCells; ++cell) {
    const double axis = 1 - 2.0 * cell / kCells, across = std::sqrt(std::max(0.0, 1 - axis * axis));
    double sum = 0;
    for (int ring = 0; ring < kRings; ++ring) {
      const double c = 1 - 2 * share * (ring + 0.5) / kRings, s = std::sqrt(1 - c * c);
      for (int turn = 0; turn < kTurns; ++turn)
        sum += phase.value(axis * c + across * s * portable_sincos_2pi((turn + 0.5) / kTurns).cos);
    }
    mean_[static_cast<size_t>(cell)] = sum / (kRings * kTurns);
  }
}

}  // namespace brume
