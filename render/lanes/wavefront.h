#pragma once
#include "render/trace/integrator.h"

namespace brume {

/// The same estimator as the general loop for plans that fit the lanes, but many paths at once: each thread keeps a
/// pool of paths and takes them through flight, scattering and shadow ray in turn, as many side by side as the machine
/// has SIMD lanes. A lane whose ray has ended is refilled with the next ray of the queue, so that lanes stay busy
/// however paths diverge.
///
/// Densities are looked up at one of the eight voxels around a point, chosen with the trilinear weights: the same
/// expectation as interpolating, for an eighth of the memory traffic (in delta tracking even the same distribution).
///
/// Each path draws from its own generator in its own order and no sum runs across paths: the same bits for any number
/// of lanes and any instruction set.
///
/// Proof: tests/render/wavefront_test.cpp, and every test of the general loop's estimators whose scene fits.
void trace_paths_in_lanes(const PathContext& context, std::span<const PathRequest> requests, const SampleSink& sink,
                          PathCounters& counters);

/// trace_paths_in_lanes where the plan says so, else the general loop.
TracePaths select_path_tracer(const Plan& plan);

}  // namespace brume
