#pragma once
#include <algorithm>
#include <cstdint>

#include "base/vec.h"

// The rules of the estimator that several stages follow, scalar ones as they stand; SIMD kernels build what they need
// as a vector from the constants.

namespace brume {

/// Light that was scattered by at most one event is direct, the rest indirect.
inline constexpr uint32_t kFirstIndirectEvents = 2;
constexpr bool is_direct(uint64_t events) {
  return events < kFirstIndirectEvents;
}

/// Multiple importance sampling: the weight of a sample drawn with density `own` where another technique draws it with
/// density `other`; 1 where that never does. Source: Veach 1997, balance heuristic.
constexpr double balance(double own, double other) {
  return other > 0 ? own / (own + other) : 1.0;
}

/// Russian roulette after roulette_start events: the largest channel's throughput, but never less than this.
inline constexpr double kLeastSurvival = 0.05;
constexpr double survival(double largest_throughput) {
  return std::clamp(largest_throughput, kLeastSurvival, 1.0);
}

/// Length of the strata in which emission is sampled [voxels]: scattering blurs what comes after it.
constexpr double emission_stride(uint64_t events) {
  return events == 0 ? 1.0 : 4.0;
}

/// The virtual flash image of a path. @param lamp  the lamp's contribution at intensity 1
inline dvec3 flash_image(const dvec3& direct, double intensity, const dvec3& lamp) {
  return direct + intensity * lamp;
}

}  // namespace brume
