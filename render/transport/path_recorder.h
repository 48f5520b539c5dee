#pragma once
#include <array>

#include "render/transport/integrator.h"
#include "render/transport/world_paths.h"

namespace brume {

/// Fills the records of the paths in flight on one thread (PathRecord): their first two collisions with media, and what
/// becomes of the first light sample.
class PathRecorder {
 public:
  /// Refers to all of them.
  PathRecorder(const PathContext& context, const PathStates& paths, WorldPaths& world)
      : c_(context), p_(paths), w_(world) {}

  /// Flights that end in a collision, before it scatters.
  void collide(const SlotList& hits);
  /// Paths that go on from one.
  void turn(const SlotList& alive);
  /// Light samples, before what lies between dims them.
  void sample_lights(const SlotList& shadows);
  /// What is left of them in the end.
  void receive(const SlotList& shadows);

 private:
  const PathContext& c_;
  const PathStates& p_;
  WorldPaths& w_;
  std::array<double, kPool> unoccluded_;
};

/// What a path's sample says. @param surface_first  whether the first event was on a surface
void finish_record(PathRecord& record, const PathSample& sample, bool surface_first);

}  // namespace brume
