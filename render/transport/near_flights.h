#pragma once
#include <vector>

#include "render/transport/media_flights.h"

namespace brume {

/// Light of small lamps scattered once along a flight: the part that collisions leave out (NearLight), at a point that
/// is chosen by its distance from the lamp.
///
/// Source: Kulla, Fajardo 2012, as near_light.h says.
class NearFlights {
 public:
  /// Refers to all of them.
  NearFlights(const PathContext& context, PathStates& paths, WorldPaths& world, MediaFlights& flights,
              TrackingCounters& counters);
  /// Adds that light for the flights of the slots, up to WorldPaths::end.
  void add(const SlotList& rays);

 private:
  void add(const NearLight& near, size_t slot);
  std::pair<double, double> part_in_media(const Ray& ray, double end) const;

  const PathContext& c_;
  PathStates& p_;
  WorldPaths& w_;
  MediaFlights& flights_;
  TrackingCounters& counters_;
  std::vector<Medium::Sphere> spheres_;  // around the media
};

}  // namespace brume
