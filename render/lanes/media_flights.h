#pragma once
#include <memory>
#include <vector>

#include "render/lanes/camera_layers.h"
#include "render/lanes/lane_scene.h"
#include "render/lanes/world_paths.h"

namespace brume {

/// Flights and shadow rays through any number of still grey media: grids in lanes, homogeneous shapes in closed form.
class MediaFlights {
 public:
  /// Refers to context and world.
  MediaFlights(const PathContext& context, const WorldPaths& world);

  size_t count() const { return scenes_.size(); }
  const LaneScene& scene(size_t medium) const { return scenes_[medium]; }

  /// Whether a ray passes through a medium.
  bool met_by(const Ray& ray) const;
  /// Free flights: moves WorldPaths::end to the first real collision of all media before it, and notes whose it is.
  /// Collisions with each medium are independent Poisson processes, so the first of all is the path's.
  void fly(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters);
  /// Multiplies PathStates::transmittance by estimates of the media's along the shadow rays.
  void shadow(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters);
  /// Puts the rays that cross a grid before `end` on a list, and their parts inside it into the local columns.
  /// @param end  of slots; null for infinity
  void enter(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays, SlotList& inside) const;
  /// Unbiased transmittance of one ray.
  double transmittance(const Ray& ray, double end, Rng& rng, TrackingCounters& counters) const;

 private:
  const PathContext& c_;
  std::vector<LaneScene> scenes_;         // of the media
  std::vector<HomogeneousShape> bounds_;  // of the media, local
  SlotList inside_, hits_, escapes_;
};

}  // namespace brume
