#pragma once
#include <span>
#include <vector>

#include "render/transport/camera_layers.h"
#include "render/transport/media_flights.h"
#include "render/transport/ray_packet.h"

namespace brume {

/// What camera rays record besides light, for the paths in flight on one thread: coverage and gradient of the nearest
/// isosurface, optical depth, the gradient weighted by transmittance.
class CameraRays {
 public:
  struct Buffers {
    CameraRayLayers layers;
    IsosurfaceCrossings crossings;
    GradientPoints points;
    std::vector<RayPacket> packets;
    SlotList walks, packed;
  };
  /// Refers to all of them. @param samples  of the slots
  CameraRays(const PathContext& context, std::span<const PathRequest> requests, PathStates& paths, Buffers& buffers,
             std::span<PathSample> samples)
      : c_(context), requests_(requests), p_(paths), b_(buffers), samples_(samples) {}

  /// Of a path that starts in a slot. @param begin  where one_grid: the ray parameter from which the isosurface is
  ///                                                searched, in lane units; negative where the ray never meets it
  void start(int32_t slot, float begin);
  /// Where Plan::one_grid: the rays begin where they enter the grid.
  void record_in_grid(const LaneScene& scene, const SlotList& fresh);
  /// Elsewhere.
  void record_in_world(MediaFlights& flights, WorldPaths& world, const SlotList& fresh);
  /// Coverage and gradient of a path in a slot.
  void write(size_t slot, PathSample& sample) const;

 private:
  void sort(const SlotList& fresh);
  void find_in_grid(const LaneScene& scene, const SlotList& fresh);
  void find_in_world(MediaFlights& flights, WorldPaths& world, const SlotList& fresh, size_t medium);
  void find_one_by_one(WorldPaths& world, int32_t slot, const Medium& medium, double begin);
  void look_again(size_t medium);
  void march(const LaneScene& scene, const SlotList& fresh);
  void cover(size_t slot, const dvec3& gradient);
  void add_point(int32_t slot, float t);
  dvec3 gradient_at(size_t point, size_t medium) const;
  PathSample& sample_of(int32_t slot) { return samples_[static_cast<size_t>(slot)]; }
  const PathRequest& request_of(int32_t slot) const { return requests_[p_.request[static_cast<size_t>(slot)]]; }

  const PathContext& c_;
  std::span<const PathRequest> requests_;
  PathStates& p_;
  Buffers& b_;
  std::span<PathSample> samples_;
};

}  // namespace brume
