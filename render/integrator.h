#pragma once
#include <functional>
#include <limits>
#include <span>

#include "base/rng.h"
#include "render/near_light.h"
#include "render/path_record.h"
#include "render/plan.h"
#include "render/surfaces.h"
#include "volume/lane_grid.h"
#include "volume/tracking.h"

namespace brume {

/// Counted per thread and summed.
struct PathCounters {
  TrackingCounters tracking;
  uint64_t paths = 0;
  uint64_t capped_paths = 0;     ///< cut at max_events
  double capped_throughput = 0;  ///< what they still carried, summed
  uint64_t longest = 0;          ///< most scatterings of a path
  void merge(const PathCounters& other);
};

/// The lamp at the eye of the virtual flash image (FILTERS.md A4).
struct FlashLamp {
  double intensity = 0;         ///< makes up for the indirect light that the image leaves out
  double typical_gradient = 0;  ///< density per scene unit: half of the relief's weight
  double distance = 1;          ///< to the middle of the media: there the lamp's falloff is 1
  bool falloff = true, shading = true;
  dvec3 offset{0};  ///< from the eye; unless 0, the lamp's light is weakened on its way
};

/// The scene as the inner loop sees it.
struct PathContext {
  std::span<const Medium> media;
  std::span<const EmissionField> emissions;
  const Lights* lights = nullptr;
  const Surfaces* surfaces = nullptr;
  const LaneGrid* lane_grid = nullptr;   ///< of the one medium, where plan.lanes
  std::span<const LaneGrid> glow_grids;  ///< of the emissions, where plan.lanes
  bool interpolate = false;              ///< in lanes: look up all eight voxels around a point, not one by chance
  Plan plan;
  int max_events = 100000, roulette_start = 16;
  double first_majorant = 1;   ///< factor on the majorants of the first flight, where plan.forced_first
  double surface_density = 0;  ///< share of each medium's maximum
  FlashLamp flash;
  std::vector<NearLight> near_lights;  ///< whose light is sampled along flights as well
  dvec3 world_shift{0};
};

/// Where the rays of a pixel can first meet something (LaneGrid::first_meeting), rounded down.
struct PixelStart {
  static constexpr float kNever = std::numeric_limits<float>::max();
  float medium = 0, surface = 0;
  int16_t axis = -1, layer = 0;  ///< of voxels, where all its rays are walked together
};

/// One camera ray to follow.
struct PathRequest {
  Ray ray;
  double time = 0;  ///< in [0, 1] of the shutter
  SampleKey key;
  PixelStart start{};            ///< of its pixel; used in lanes
  PathRecord* record = nullptr;  ///< filled where not null; never in lanes
};

/// Takes the sample of the request with an index, in any order, one at a time.
using SampleSink = std::function<void(size_t index, const PathSample& sample)>;

/// Follows a batch of paths from the eye; each sample depends on its request alone. Unbiased but for max_events.
///
/// Sources: TRANSPORT.md sections 1, 4, 6, 7, 9, 11; Veach 1997 for the balance heuristic.
/// Proof: tests/render/furnace_test.cpp, slab_test.cpp, sphere_test.cpp, analogue_test.cpp
using TracePaths = void (*)(const PathContext&, std::span<const PathRequest>, const SampleSink&, PathCounters&);

/// The instantiation of the loop that models what the plan needs and nothing else.
TracePaths select_path_tracer(const Plan& plan);

}  // namespace brume
