#pragma once
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "base/progress.h"
#include "base/rng.h"
#include "render/transport/path_record.h"
#include "render/transport/plan.h"
#include "render/world/surfaces.h"
#include "volume/lane_grid.h"
#include "volume/tracking.h"

namespace brume {

class Camera;

/// What render.indirect_limit took. Radiance is the mean of the channels, summed over paths; 0 without a limit.
struct LimitedLight {
  uint64_t paths = 0;  ///< that were limited
  double taken = 0;    ///< radiance that they lost
  double found = 0;    ///< indirect light of all paths before
  void merge(const LimitedLight& other);
};

/// Counted per thread and summed.
struct PathCounters {
  TrackingCounters tracking;
  uint64_t paths = 0;
  uint64_t capped_paths = 0;     ///< cut at max_events
  double capped_throughput = 0;  ///< what they still carried, summed
  uint64_t longest = 0;          ///< most scatterings of a path
  LimitedLight limited;
  void merge(const PathCounters& other);
};

/// The lamp at the eye of the virtual flash image (docs/methods.md, Virtual flash image).
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
  std::span<const LaneGrid> lane_grids;      ///< of the media that single precision resolves
  std::span<const LaneGrid> emission_grids;  ///< of the emissions that are still grids, likewise
  std::span<const DisplacedLaneGrid>
      displaced_grids;  ///< of the media that are displaced or cross small cells, likewise
  Plan plan;
  int max_events = 100000, roulette_start = 16;
  double indirect_limit = 0;      ///< see limit_indirect; 0: none
  double isosurface_density = 0;  ///< share of each medium's maximum
  FlashLamp flash;
  dvec3 world_shift{0};
  const StopSignal* stop = nullptr;  ///< polled inside flights; tracing throws Interrupted where it says so
};

/// The media as they are at a time in [0, 1] of the shutter: valid until the thread asks again.
std::span<const Medium> media_at(const PathContext& context, double time);

/// Lower bounds of the ray parameters at which the rays of a pixel enter the medium and meet its isosurface,
/// rounded down: see LaneGrid::Entry.
struct EntryBound {
  static constexpr float kNever = std::numeric_limits<float>::max();
  float medium = 0, surface = 0;
  int16_t axis = -1, layer = 0;  ///< where the pixel's rays are marched as a packet
};

/// One camera ray to follow.
struct PathRequest {
  Ray ray;
  double time = 0;  ///< in [0, 1] of the shutter
  SampleKey key;
  EntryBound start{};            ///< of the pixel
  PathRecord* record = nullptr;  ///< filled where not null; needs LayerRequest::records
  uint32_t* events = nullptr;    ///< where not null, the events of its paths are added
};

/// The camera ray and the random numbers of one sample of pixel (x, y) of the whole picture.
PathRequest camera_request(const Scene& scene, const Plan& plan, const Camera& camera, int64_t seed, int x, int y,
                           uint32_t sample, const EntryBound& start = {});
/// The same for a grid of pixels spread over the picture, for what is estimated before a render. They have a seed of
/// their own, so that such an estimate is a constant of the scene.
std::vector<PathRequest> coarse_requests(const Scene& scene, const Plan& plan, const Camera& camera, int grid,
                                         uint32_t samples);
/// Of one row of a grid of columns x rows.
std::vector<PathRequest> coarse_requests(const Scene& scene, const Plan& plan, const Camera& camera, int columns,
                                         int rows, int row, uint32_t samples);

/// Takes the sample of the request with an index, in any order, one at a time.
using SampleSink = std::function<void(size_t index, const PathSample& sample)>;

/// Scales the indirect light of a path whose mean over the channels is above the limit down to it, and counts what it
/// takes. Light that is not finite is left, to be rejected with its sample.
/// @return  the factor
double limit_indirect(double limit, dvec3& indirect, LimitedLight& count);

}  // namespace brume
