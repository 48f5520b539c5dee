#pragma once
#include <functional>
#include <vector>

#include "render/transport/lit_balls.h"
#include "render/transport/media_flights.h"
#include "render/transport/surface_events.h"
#include "render/transport/world_paths.h"

namespace brume {

/// A light sample, with a shadow ray, of every light group at a path's first vertices, where the picture has one of one
/// light: for `light.NAME.aimed`, whose noise is that of a render of the group's lights alone. The picture and the
/// layers `light.NAME` keep their random numbers and do without.
class GroupLights {
 public:
  using GroupLight = WorldPaths::GroupLight;

  /// Whether the layers are wanted and there are samples of more than one group to choose among.
  static bool wanted(const PathContext& context);

  /// Refers to all of them. @param surfaces, balls  null where there are none
  GroupLights(const PathContext& context, PathStates& paths, WorldPaths& world, MediaFlights& flights,
              SurfaceEvents* surfaces, const BallSamples* balls);

  /// Of a path that begins.
  void start(size_t slot);
  /// Samples every group at the ends of flights, before anything else happens there. The paths are as they were.
  /// @param hits  collisions with media
  /// @param met   surfaces
  void sample(std::span<const PathRequest> requests, const SlotList& hits, const SlotList& met);
  /// Takes note of what the picture's own light sample brought at the same vertex: it counts no more.
  void replace(size_t slot, const vec3& L);
  /// Takes note of light that a path finds by its direction, after its last event at p. Where the group was sampled
  /// there by itself, both techniques are weighted by how likely that chose the light.
  /// @param fields    whether the picture chose among fields that emit, too
  /// @param weighted  gives the light, weighted against light sampling that chooses its light with a probability
  void found(size_t slot, const Light& light, const dvec3& p, bool fields,
             const std::function<dvec3(double probability)>& weighted);
  /// Light of a group that `aimed` has more than `light.NAME`.
  const GroupLight& apart(size_t slot, size_t group) const { return apart_[slot * w_.groups + group]; }

 private:
  std::span<const Light* const> lights_of(size_t group) const;
  double probability_of_group(size_t group, const dvec3& p, bool fields) const;
  LightSample sample_of(size_t group, size_t slot, const dvec3& p, bool fields);
  bool aim_from_medium(size_t slot, size_t group);

  const PathContext& c_;
  PathStates& p_;
  WorldPaths& w_;
  MediaFlights& flights_;
  SurfaceEvents* surfaces_;
  const BallSamples* balls_;
  std::vector<const Light*> lights_;              // that are sampled, by group
  std::vector<size_t> first_;                     // of each group's lights; behind them their number
  std::vector<GroupLight> apart_;                 // by slot and group
  std::vector<bool> sampled_;                     // slots, at their vertex
  std::vector<bool> knows_shares_;                // likewise: whether shares_ are those of the vertex
  std::vector<double> shares_;                    // of the picture's choice, by slot and light
  std::vector<PathGenerator::State> generators_;  // of the slots
  SlotList hits_, met_, shadows_;
};

}  // namespace brume
