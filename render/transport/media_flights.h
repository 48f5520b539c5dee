#pragma once
#include <array>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "render/transport/camera_layers.h"
#include "render/transport/lane_scene.h"
#include "render/transport/local_rays.h"
#include "render/transport/world_paths.h"

namespace brume {

/// Flights and shadow rays through any number of media: homogeneous shapes in closed form; grids in SIMD lanes; and, in
/// double precision and one after the other, grids that single precision does not resolve (single_precision_resolves).
class MediaFlights {
 public:
  /// Refers to all of them.
  MediaFlights(const PathContext& context, PathStates& paths, WorldPaths& world, TrackingCounters& counters);
  ~MediaFlights();

  size_t count() const { return scenes_.size(); }
  const LaneScene& scene(size_t medium) const { return scenes_[medium]; }
  bool in_lanes(size_t medium) const { return kinds_[medium] == Kind::kLanes; }

  /// Whether a ray passes through a medium at a time of the shutter.
  bool met_by(const Ray& ray, double time) const;
  /// Places the media for a path in a slot, at its time.
  void place(size_t slot, double time);
  /// Free flights: moves WorldPaths::end to the first real collision of all media before it, and notes whose it is.
  /// Collisions with each medium are independent Poisson processes, so the first of all is the path's. Where media are
  /// chromatic the hero channel's collisions count.
  void fly(const SlotList& rays);
  /// Where media are chromatic, after fly(): each channel's probability density of passing all that lies before a ray
  /// parameter, which must not be beyond the flight's end. @param factor  of slots
  void passing(const SlotList& rays, const std::array<double, kPool>& end, std::array<vec3, kPool>& factor);
  /// The same up to the flight's end and with the collision there, which the paths' throughput and densities get.
  void weigh_channels(const SlotList& rays);
  /// Estimates the media's transmittance along the shadow rays: PathStates::transmittance, where media are chromatic
  /// times shadow_r, shadow_g, shadow_b.
  void shadow(const SlotList& rays);
  /// Puts the rays that cross a grid before `end` on a list, and their parts inside it into the local columns.
  void enter(size_t medium, const SlotList& rays, const std::array<double, kPool>& end, SlotList& inside);
  /// Unbiased transmittance of one ray. @param media  at the path's time
  dvec3 transmittance(std::span<const Medium> media, const Ray& ray, double end, Rng& rng) const;

 private:
  enum class Kind { kShape, kLanes, kDouble };
  using Placements = std::array<Placement::ToLocal, kPool>;
  struct Flown;
  Ray to_local(size_t medium, size_t slot, const Ray& ray) const {
    return (placed_[medium] ? (*placed_[medium])[slot] : c_.media[medium].placement().to_local())(ray);
  }
  std::pair<double, double> part_in_shape(size_t medium, size_t slot, const Ray& ray, double end) const;
  void fly_through_shape(size_t medium, const SlotList& rays);
  void fly_in_lanes(size_t medium, const SlotList& rays);
  void fly_in_double(size_t medium, const SlotList& rays);
  double fly_one(size_t medium, size_t slot, double end);
  void replay(size_t medium, const SlotList& rays, const std::array<double, kPool>& end,
              std::array<vec3, kPool>& probability);
  void shadow_through_shape(size_t medium, const SlotList& rays);
  void shadow_in_lanes(size_t medium, const SlotList& rays);
  void shadow_in_double(size_t medium, const SlotList& rays);
  dvec3 density_in_shape(size_t medium, size_t slot, double end) const;
  void dim(size_t medium, size_t slot, const dvec3& passes);
  bool dark(size_t slot) const;

  const PathContext& c_;
  PathStates& p_;
  WorldPaths& w_;
  TrackingCounters& counters_;
  std::vector<Kind> kinds_;                          // of the media
  std::vector<LaneScene> scenes_;                    // likewise
  std::vector<HomogeneousShape> bounds_;             // likewise, local
  std::vector<LocalBox> boxes_;                      // likewise, of grids
  std::vector<std::unique_ptr<Placements>> placed_;  // likewise, by slot; only of those whose transforms move
  std::vector<std::unique_ptr<Flown>> flown_;        // likewise; only of chromatic grids
  std::array<vec3, kPool> replayed_;
  SlotList inside_, hits_, passed_, again_;
};

/// What a choice whose densities the channels have multiplied by `factor` multiplies a path's throughput and densities
/// with: the balance heuristic over the choice of the hero, which keeps the mean density at 1.
dvec3 channel_weights(const PathStates& paths, size_t slot, const dvec3& factor);

}  // namespace brume
