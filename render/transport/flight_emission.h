#pragma once
#include <array>
#include <deque>
#include <initializer_list>

#include "render/transport/emission.h"
#include "render/transport/media_flights.h"

namespace brume {

/// What fields emit along the flights (WorldPaths::ray up to end) of the paths on one thread. A flight passes a point
/// with the probability of the transmittance to it, so no weight is needed. Scattering blurs: longer strata are enough
/// after the first event, whose light samples find the fields, too: there each look-up has its weight against those
/// (FieldLight). Where media stand still (Plan::seen_emission), what camera rays see is instead
/// integrated through them, with their exact transmittance, before they fly.
class FlightEmission {
 public:
  struct Buffers {
    std::array<vec3, kPool> seen;    ///< along camera rays
    std::array<float, kPool> paths;  ///< that go on from a camera ray
    std::array<bool, kPool> again;   ///< of paths on a camera ray that one before them has seen
    EmissionSegments segments;
    std::vector<std::unique_ptr<DimmedSegments>> dimmed;  ///< for each medium; where Plan::seen_emission
    SlotList camera, in_medium;
    std::array<double, kPool> medium_point;  ///< ray parameters
    SlotList rays;
    std::array<double, kPool> point;  ///< ray parameters
    std::array<size_t, kPool> field;
    std::array<vec3, kPool> emitted, passing;
  };
  /// Refers to all of them.
  FlightEmission(const PathContext& context, PathStates& paths, WorldPaths& world, Buffers& buffers);

  /// Whether a camera ray passes through a field.
  bool may_meet(const Ray& ray) const;
  /// @param paths  that will go on from the slot's camera ray, one after the other
  void start(size_t slot, int paths) {
    b_.seen[slot] = vec3(0);
    b_.paths[slot] = static_cast<float>(paths);
    b_.again[slot] = false;
  }
  /// Of another path that goes on from the slot's camera ray, whose emission has been seen.
  void start_again(size_t slot) { b_.again[slot] = true; }
  /// Where Plan::seen_emission: adds what the camera rays of the slots see up to WorldPaths::end.
  void see(const SlotList& slots, const MediaFlights& flights);
  /// Adds what is emitted along the flights of the slots; of camera rays only what see() does not.
  void add(std::initializer_list<const SlotList*> slots);
  /// The same where media are chromatic, before MediaFlights::Flown::weigh_channels: at one point of each flight,
  /// which each channel passes with its own probability.
  void add_by_channel(const SlotList& slots, MediaFlights::Flown& flown);
  vec3 seen(size_t slot) const { return b_.seen[slot]; }

 private:
  void see(const LaneEmission& field, const MediaFlights& flights);
  void dim(const LaneEmission& field, size_t medium, const LaneScene& scene);
  void add_in_lanes(const LaneEmission& field, std::initializer_list<const SlotList*> slots);
  void add_one_by_one(size_t field, std::initializer_list<const SlotList*> slots);
  void add(size_t slot, size_t field, const vec3& emitted);
  double rival(size_t slot, const FieldLight& light) const;
  double weight(size_t slot, size_t field, double t) const;

  const PathContext& c_;
  PathStates& p_;
  WorldPaths& w_;
  Buffers& b_;
  std::deque<LaneEmission> in_lanes_;
  std::vector<size_t> one_by_one_;  ///< homogeneous, moving, or not resolved by single precision
};

}  // namespace brume
