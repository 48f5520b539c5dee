#pragma once
#include <memory>
#include <vector>

#include "render/lanes/camera_layers.h"
#include "render/lanes/lane_scene.h"
#include "render/lanes/world_paths.h"

namespace brume {

/// Flights and shadow rays through any number of media: grids in lanes, homogeneous shapes in closed form.
class MediaFlights {
 public:
  /// Refers to context and world.
  MediaFlights(const PathContext& context, const WorldPaths& world);
  ~MediaFlights();

  size_t count() const { return scenes_.size(); }
  const LaneScene& scene(size_t medium) const { return scenes_[medium]; }

  /// Whether a ray passes through a medium at a time of the shutter.
  bool met_by(const Ray& ray, double time) const;
  /// Places the media for a path in a slot, at its time.
  void place(size_t slot, double time);
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
  /// Unbiased transmittance of one ray. @param media  at the path's time
  dvec3 transmittance(std::span<const Medium> media, const Ray& ray, double end, Rng& rng,
                      TrackingCounters& counters) const;

 private:
  using Placements = std::array<Placement, kPool>;
  struct Flown;
  Ray to_local(size_t medium, size_t slot, const Ray& ray) const {
    return (placed_[medium] ? (*placed_[medium])[slot] : c_.media[medium].placement()).to_local(ray);
  }
  void fly_through_shape(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays) const;
  void fly_through_grid(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays,
                        TrackingCounters& counters);
  void fly_again(size_t medium, PathStates& paths, WorldPaths& world, const SlotList& rays, TrackingCounters& counters);
  void weigh_channels(PathStates& paths, const WorldPaths& world, const SlotList& rays) const;

  const PathContext& c_;
  std::vector<LaneScene> scenes_;                    // of the media
  std::vector<HomogeneousShape> bounds_;             // of the media, local
  std::vector<std::unique_ptr<Placements>> placed_;  // of the media, by slot; only of those whose transforms move
  SlotList inside_, hits_, escapes_, passed_;
  std::vector<std::unique_ptr<Flown>> flown_;  // of the media; only of chromatic grids
};

}  // namespace brume
