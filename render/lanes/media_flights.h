#pragma once
#include <memory>
#include <vector>

#include "render/lanes/camera_layers.h"
#include "render/lanes/lane_scene.h"
#include "render/lanes/world_paths.h"

namespace brume {

/// Flights and shadow rays through any number of still media: grids in lanes, homogeneous shapes in closed form.
class MediaFlights {
 public:
  /// Refers to context and world.
  MediaFlights(const PathContext& context, const WorldPaths& world);
  ~MediaFlights();

  size_t count() const { return scenes_.size(); }
  const LaneScene& scene(size_t medium) const { return scenes_[medium]; }

  /// Whether a ray passes through a medium.
  bool met_by(const Ray& ray) const;
  /// Free flights: moves WorldPaths::end to the first real collision of all media before it, and notes whose it is.
  /// Collisions with each medium are independent Poisson processes, so the first of all is the path's. Where media are
  /// chromatic the hero channel's collisions count, and the paths' throughput and densities get what each channel's
  /// would have been.
  void fly(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters);
  /// Estimates the media's transmittance along the shadow rays: PathStates::transmittance, where media are chromatic
  /// times shadow_r, shadow_g, shadow_b.
  void shadow(PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters);
  /// Puts the rays that cross a grid before `end` on a list, and their parts inside it into the local columns.
  /// @param end  of slots; null for infinity
  void enter(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays, SlotList& inside) const;
  /// Unbiased transmittance of one ray.
  dvec3 transmittance(const Ray& ray, double end, Rng& rng, TrackingCounters& counters) const;

 private:
  struct Flown;
  void fly_through_shape(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays) const;
  void fly_through_grid(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays,
                        TrackingCounters& counters);
  void fly_again(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters);
  void weigh_channels(PathStates& paths, const WorldPaths& world, const SlotList& rays) const;

  const PathContext& c_;
  std::vector<LaneScene> scenes_;         // of the media
  std::vector<HomogeneousShape> bounds_;  // of the media, local
  SlotList inside_, hits_, escapes_, passed_;
  std::vector<std::unique_ptr<Flown>> flown_;  // of the media; only of chromatic grids
};

}  // namespace brume
