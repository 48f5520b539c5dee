#pragma once
#include <optional>
#include <span>

#include "render/transport/integrator.h"
#include "render/transport/world_paths.h"

namespace brume {

class GroupLights;

/// A light sample that is worth a shadow ray.
struct AimedLight {
  Ray shadow;
  double end;     ///< ray parameter of the light
  vec3 L{0};      ///< what it brings if nothing is in the way
  float mis = 1;  ///< its weight against direction sampling
};

/// What happens to paths on meshes, one path at a time: Embree and the BSDFs are scalar.
class SurfaceEvents {
 public:
  /// Refers to all of them. @param samples  of the slots
  SurfaceEvents(const PathContext& context, PathStates& paths, WorldPaths& world, std::span<PathSample> samples,
                PathCounters& counters)
      : c_(context), p_(paths), w_(world), samples_(samples), counters_(counters) {}

  /// Lets a path meet the surface that its flight ends on: its emission, a sample of one light, roulette, a direction
  /// of the BSDF. False where the path ends.
  /// @param eye      where its camera ray begins
  /// @param shadows  gets the slot where the light sample is worth a shadow ray
  /// @param balls    draws points of lit balls; null where there are none
  /// @param groups   samples the other light groups; null where there are none
  bool meet(size_t slot, const dvec3& eye, SlotList& shadows, BallSamples* balls, GroupLights* groups);
  /// Makes a light sample the one whose shadow ray a slot has.
  void take(size_t slot, const AimedLight& light);
  /// What surfaces leave of the light samples. Drops those that are dark from the list.
  void shadow(SlotList& shadows);

 private:
  struct Vertex;
  void sample_light(size_t slot, const Vertex& vertex, const dvec3& from, bool only_technique, SlotList& shadows);
  std::optional<AimedLight> aim_at(size_t slot, const Vertex& vertex, const dvec3& from, const LightSample& light,
                                   bool only_technique);
  bool scatter(size_t slot, const Vertex& vertex);
  bool pass_catcher(size_t slot, const Vertex& vertex, SlotList& shadows);
  void emit(size_t slot, const Vertex& vertex, const dvec3& radiance);
  /// Lights that new directions aim at.
  const Lights* aims() const { return c_.plan.aims_at_fire ? c_.lights : nullptr; }
  dvec3 throughput(size_t i) const { return dvec3(p_.throughput[i]); }

  const PathContext& c_;
  PathStates& p_;
  WorldPaths& w_;
  std::span<PathSample> samples_;
  PathCounters& counters_;
};

}  // namespace brume
