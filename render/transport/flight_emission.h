#pragma once
#include <array>
#include <deque>
#include <initializer_list>

#include "render/transport/emission.h"
#include "render/transport/media_flights.h"

namespace brume {

/// What fields emit along the flights of the paths on one thread. A flight passes a point with the probability of the
/// transmittance to it, so no weight is needed. Scattering blurs: longer strata are enough after the first event.
class FlightEmission {
 public:
  struct Buffers {
    std::array<Ray, kPool> ray;  ///< flights in the world, the camera's from the eye on; only where one_grid
    std::array<double, kPool> end;
    std::array<vec3, kPool> seen;  ///< along camera rays
    EmissionSegments segments;
    SlotList rays;
    std::array<double, kPool> point;  ///< ray parameters
    std::array<vec3, kPool> emitted, passing;
  };
  /// Refers to all of them. @param world  null where one_grid
  FlightEmission(const PathContext& context, PathStates& paths, WorldPaths* world, Buffers& buffers);

  /// Whether a camera ray passes through a field.
  bool may_meet(const Ray& ray) const;
  void start(int32_t slot) { b_.seen[static_cast<size_t>(slot)] = vec3(0); }
  /// Where one_grid: the flight of a path in a slot, up to its end.
  void set(size_t slot, const Ray& ray, double end) {
    b_.ray[slot] = ray;
    b_.end[slot] = end;
  }
  const Ray& ray(size_t slot) const { return b_.ray[slot]; }
  /// Adds what is emitted along the flights of the slots.
  void add(std::initializer_list<const SlotList*> slots);
  /// The same where media are chromatic, between MediaFlights::fly and weigh_channels: at one point of each flight,
  /// which each channel passes with its own probability.
  void add_by_channel(const SlotList& slots, MediaFlights& flights);
  vec3 seen(size_t slot) const { return b_.seen[slot]; }

 private:
  void add_in_lanes(const LaneEmission& field, std::initializer_list<const SlotList*> slots);
  void add_one_by_one(const EmissionField& field, std::initializer_list<const SlotList*> slots);
  void add(size_t slot, const vec3& emitted);

  const PathContext& c_;
  PathStates& p_;
  WorldPaths* w_;
  Buffers& b_;
  const std::array<Ray, kPool>& rays_;
  const std::array<double, kPool>& ends_;
  std::deque<LaneEmission> in_lanes_;
  std::vector<const EmissionField*> one_by_one_;  ///< they move, or single precision does not resolve them
};

}  // namespace brume
