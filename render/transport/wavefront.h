#pragma once
#include "render/transport/integrator.h"

namespace brume {

/// Follows a batch of paths from the eye; each sample depends on its request alone. Unbiased but for max_events and
/// indirect_limit. Every scene is traced here.
///
/// Many paths at once: each thread keeps a pool of paths and takes them in turn through flight, emission, event and
/// shadow ray, each stage a file of its own. Flights through grids and scattering run in as many SIMD lanes as the
/// machine has; a lane whose ray has ended is refilled with the next ray of the queue, so that lanes stay busy however
/// paths diverge. Paths live in the world in double precision; where all there is lies in one still grey grid, in its
/// local coordinates in single precision (Plan::one_grid).
///
/// Densities are looked up at one of the eight voxels around a point, chosen with the trilinear weights: the same
/// expectation as interpolating, for an eighth of the memory traffic (in delta tracking even the same distribution).
///
/// Each path draws from its own generator in its own order and no sum runs across paths: the same bits for any number
/// of lanes and any instruction set.
///
/// Sources: docs/methods.md; Veach 1997 for the balance heuristic.
/// Proof: tests/render/reference_test.cpp (the definition of the estimator, tests/support/reference_tracer.h, on random
/// scenes), wavefront_test.cpp, furnace_test.cpp, slab_test.cpp, sphere_test.cpp, analogue_test.cpp
void trace_paths(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
                 PathCounters& counters);

}  // namespace brume
