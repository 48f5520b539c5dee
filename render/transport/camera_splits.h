#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "base/vec.h"
#include "render/transport/path_sample.h"
#include "render/transport/path_states.h"

namespace brume {

/// Splitting at the first event: several paths, one after the other in the same slot, go on from one camera ray, whose
/// walk through media that emit costs more than they do. Each is a path as if it were the only one; the sample of the
/// camera ray is their mean, with what the ray itself sees counted once. What PathStates and WorldPaths sum up goes on
/// from path to path and is divided at the end; here is what does not.
///
/// Source: splitting, Arvo, Kirk 1990, Particle Transport and Image Synthesis.
/// Proof: tests/render/camera_splits_test.cpp
class CameraSplits {
 public:
  /// Probability with which one of a ray's paths goes on after it has scattered so many times. What deep events bring
  /// falls as the albedo does, and their variance with its square, while they cost the same: roulette by its root from
  /// the third event on costs a tenth of the error and saves a third of the time (docs/performance.md).
  static double survival(uint32_t events, double albedo) {
    return events < kFirstRoulette ? 1.0 : std::clamp(std::sqrt(albedo), 0.3, 1.0);
  }
  static constexpr uint32_t kFirstRoulette = 3;

  /// How one path has ended.
  struct End {
    dvec3 background{0};  ///< transmittance to it, of a path that saw it
    dvec3 hole{0};        ///< the weight of a path that ended on a holdout
    bool first_on_surface = false;
  };

  /// @param keeps_samples  whether paths have samples of layers
  explicit CameraSplits(bool keeps_samples) : samples_(keeps_samples ? kPool : 0) {}

  /// Of a camera ray from which `count` paths will go on.
  void start(size_t slot, int count);
  int count(size_t slot) const { return sums_[slot].count; }
  /// Takes a path's end, and its sample where there are any. Returns whether another path has to go on from the ray.
  /// @param indirect  light of all its paths so far
  bool end(size_t slot, const End& end, const vec3& indirect, PathSample* sample);
  /// Means over the paths of a ray all of which have ended.
  dvec3 background(size_t slot) const { return sums_[slot].background * share(slot); }
  dvec3 hole(size_t slot) const { return sums_[slot].hole * share(slot); }
  dvec3 surface_indirect(size_t slot) const { return dvec3(sums_[slot].surface_indirect) * share(slot); }
  PathSample sample(size_t slot) const;
  double share(size_t slot) const { return 1.0 / sums_[slot].count; }

 private:
  struct Sums {
    int count, ended;
    dvec3 background, hole;
    vec3 indirect;          // of all paths that have ended
    vec3 surface_indirect;  // of those whose first event was on a surface
  };
  std::array<Sums, kPool> sums_;
  std::vector<PathSample> samples_;
};

}  // namespace brume
