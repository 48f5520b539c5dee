#pragma once
#include <array>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "render/transport/camera_layers.h"
#include "render/transport/instance_visits.h"
#include "render/transport/lane_scene.h"
#include "render/transport/local_rays.h"
#include "render/transport/world_paths.h"

namespace brume {

/// Flights and shadow rays through any number of media: shapes in closed form; grids in SIMD lanes; and, in
/// double precision and one after the other, grids that single precision does not resolve.
class MediaFlights {
 public:
  /// Refers to all of them.
  MediaFlights(const PathContext& context, PathStates& paths, WorldPaths& world, TrackingCounters& counters);
  ~MediaFlights();

  size_t count() const { return scenes_.size(); }
  const LaneScene& scene(size_t medium) const { return scenes_[medium]; }
  bool in_lanes(size_t medium) const { return c_.plan.media[medium] == Precision::kLanes; }

  /// Where the one grid's camera rays begin.
  struct Start {
    bool meets;     ///< whether the ray meets a medium, as far as nothing else is in its way
    float surface;  ///< ray parameter of the local ray from which on it may meet the isosurface; negative: never
  };
  /// Puts a path at the eye into a slot: its ray and the places of the media at its time. Where Plan::one_grid, its
  /// local ray begins where it can first enter the grid: near the medium single precision is enough.
  Start start(size_t slot, const PathRequest& request);
  /// Where Plan::one_grid: free flights from event to event, or forced ones of camera rays.
  void fly_in_grid(const SlotList& rays, SlotList& hits, SlotList& escapes);
  void fly_first_in_grid(const SlotList& rays, SlotList& hits, SlotList& escapes);

  /// Flights that have been flown, before the next ones are.
  class Flown {
   public:
    /// Where media are chromatic: each channel's probability density of passing all that lies before a ray parameter,
    /// which must not be beyond the flight's end. @param factor  of slots
    void passing(const SlotList& rays, const std::array<double, kPool>& end, std::array<vec3, kPool>& factor) {
      flights_.passing(rays, end, factor);
    }
    /// The same up to the flights' ends and with the collisions there, which the paths' throughput and densities get:
    /// the last that is asked of these flights.
    void weigh_channels() && { flights_.weigh_channels(rays_); }

   private:
    friend MediaFlights;
    Flown(MediaFlights& flights, const SlotList& rays) : flights_(flights), rays_(rays) {}
    MediaFlights& flights_;
    const SlotList& rays_;
  };
  /// Free flights: moves WorldPaths::end to the first real collision of all media before it, and notes whose it is.
  /// Collisions with each medium are independent Poisson processes, so the first of all is the path's. Where media are
  /// chromatic the hero channel's collisions count, and Flown::weigh_channels has to follow.
  Flown fly(const SlotList& rays);
  /// Estimates the media's transmittance along the shadow rays: PathStates::transmittance, where media are chromatic
  /// times shadow_colour.
  void shadow(const SlotList& rays);
  /// Puts the rays that cross a grid before `end` on a list, and their parts inside it into the local columns. Not of a
  /// medium with instances.
  void enter(size_t medium, const SlotList& rays, const std::array<double, kPool>& end, SlotList& inside);
  /// Unbiased transmittance of one ray. @param media  at the path's time
  dvec3 transmittance(std::span<const Medium> media, const Ray& ray, double end, Rng& rng) const;

 private:
  using Placements = std::array<Placement::ToLocal, kPool>;
  struct Replay;
  Ray to_local(size_t medium, size_t slot, const Ray& ray) const {
    return (placed_[medium] ? (*placed_[medium])[slot] : c_.media[medium].placement().to_local())(ray);
  }
  Start start_in_grid(size_t slot, const PathRequest& request);
  bool met_by(const Ray& ray, double time) const;
  template <class Left, class Walk>
  void walk_grid(size_t medium, const SlotList& rays, const std::array<Ray, kPool>& from,
                 const std::array<double, kPool>& end, LocalRays& to, const Left& left, const Walk& walk);
  template <class Visit>
  void each_part_in_shape(size_t medium, size_t slot, const Ray& ray, const double& end, const Visit& visit) const;
  void collide(size_t slot, double t, size_t medium, size_t instance) {
    w_.end[slot] = t;
    w_.medium[slot] = static_cast<int32_t>(medium);
    w_.instance[slot] = static_cast<int32_t>(instance);
  }
  void passing(const SlotList& rays, const std::array<double, kPool>& end, std::array<vec3, kPool>& factor);
  void weigh_channels(const SlotList& rays);
  void fly_through_shape(size_t medium, const SlotList& rays);
  void fly_in_lanes(size_t medium, const SlotList& rays);
  void fly_in_double(size_t medium, const SlotList& rays);
  Collision fly_one(const Medium& medium, size_t slot, double end);
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
  std::vector<LaneScene> scenes_;                    // of the media
  std::vector<HomogeneousShape> bounds_;             // likewise, local
  std::vector<LocalBox> boxes_;                      // likewise, of grids
  std::vector<std::unique_ptr<Placements>> placed_;  // likewise, by slot; only of those whose transforms move
  std::unique_ptr<InstanceVisits> visits_;           // where some have instances
  std::vector<std::unique_ptr<Replay>> replays_;     // likewise; only of chromatic grids
  std::array<vec3, kPool> replayed_;
  SlotList inside_, hits_, passed_, again_, going_;
};

/// What a choice whose densities the channels have multiplied by `factor` multiplies a path's throughput and densities
/// with: the balance heuristic over the choice of the hero, which keeps the mean density at 1.
dvec3 channel_weights(const PathStates& paths, size_t slot, const dvec3& factor);

}  // namespace brume
