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
  CameraRays(const PathContext& context, std::span<const PathRequest> requests, PathStates& paths, WorldPaths& world,
             MediaFlights& flights, Buffers& buffers, std::span<PathSample> samples)
      : c_(context), requests_(requests), p_(paths), w_(world), flights_(flights), b_(buffers), samples_(samples) {}

  /// Of a path that starts in a slot. @param begin  ray parameter of its local ray from which the isosurface is
  ///                                                searched; negative where the ray never meets it
  void start(size_t slot, float begin);
  void record(const SlotList& fresh);
  /// Coverage and gradient of a path in a slot.
  void write(size_t slot, PathSample& sample) const;

 private:
  void sort(const SlotList& fresh);
  void find(const SlotList& fresh, size_t medium);
  void find_one_by_one(size_t slot, const Medium& medium);
  void look_again(size_t medium);
  void march(const SlotList& fresh, size_t medium);
  void march_one_by_one(size_t slot, const Medium& medium);
  void cover(size_t slot, const dvec3& gradient);
  void add_point(size_t slot, float t);
  dvec3 gradient_at(size_t point, size_t medium) const;
  const PathRequest& request_of(size_t slot) const { return requests_[p_.request[slot]]; }

  const PathContext& c_;
  std::span<const PathRequest> requests_;
  PathStates& p_;
  WorldPaths& w_;
  MediaFlights& flights_;
  Buffers& b_;
  std::span<PathSample> samples_;
};

}  // namespace brume
