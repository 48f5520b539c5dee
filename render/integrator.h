#pragma once
#include <optional>

#include "base/rng.h"
#include "render/lights.h"
#include "render/plan.h"
#include "volume/tracking.h"

namespace brume {

/// What one path tells about its pixel. Every member is an unbiased sample of an expectation.
struct PathSample {
  dvec3 direct{0};      ///< background through the medium, and light scattered once
  dvec3 indirect{0};    ///< light scattered twice or more
  dvec3 gradient{0};    ///< unit direction of the density gradient where the ray meets the surface; 0 where undefined
  double coverage = 0;  ///< 1 where the ray meets the medium's surface
  double transmittance = 0;  ///< 1 where the path never scattered
};

/// Counted per thread and summed.
struct PathCounters {
  TrackingCounters tracking;
  uint64_t paths = 0;
  uint64_t capped_paths = 0;     ///< cut at max_events
  double capped_throughput = 0;  ///< what they still carried, summed
  uint64_t longest = 0;          ///< most scatterings of a path
  void merge(const PathCounters& other);
};

/// The scene as the inner loop sees it.
struct PathContext {
  const Medium* medium = nullptr;
  const Lights* lights = nullptr;
  Plan plan;
  int max_events = 100000, roulette_start = 16;
  float surface_density = 0;  ///< absolute
};

/// Follows one path from the eye. Unbiased but for max_events.
///
/// Sources: TRANSPORT.md sections 1, 6, 7, 11; Veach 1997 for the balance heuristic.
/// Proof: tests/render/furnace_test.cpp, slab_test.cpp, sphere_test.cpp and analogue_test.cpp
using TracePath = PathSample (*)(const PathContext&, const Ray&, const Sobol&, Rng&, PathCounters&);

/// The instantiation of the loop that models what the plan needs and nothing else.
TracePath select_path_tracer(const Plan& plan);

}  // namespace brume
