#pragma once
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "render/transport/lit_balls.h"
#include "render/transport/media_flights.h"
#include "render/transport/surface_events.h"
#include "render/transport/world_paths.h"

namespace brume {

/// A light sample, with a shadow ray, of every light group at a path's first vertices, where the picture has one of one
/// light: for `light.NAME.aimed`, whose noise is that of a render of the group's lights alone. The picture's own sample
/// is its group's, weighed as if no other group could have been chosen; the picture and the layers `light.NAME` keep
/// their random numbers and do without the others.
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
  /// At the ends of flights, before anything else happens there.
  /// @param hits  collisions with media
  /// @param met   surfaces
  void begin_vertices(std::span<const PathRequest> requests, const SlotList& hits, const SlotList& met);
  /// At a surface, once the picture has drawn its light sample: draws those of the other groups.
  /// @param aim  (light) tells the AimedLight of a light sample, if it is worth a shadow ray
  template <class Aim>
  void aim_from_surface(size_t slot, const dvec3& p, const Aim& aim) {
    if (!sampled_[slot]) return;
    PathGenerator rng(p_, slot);
    const PathGenerator::State of_path = rng.state();
    rng.set(own_[slot]);
    find_shares(slot, p, true);
    for (size_t group = 0; group < w_.groups; ++group) {
      if (!samples(slot, group)) continue;
      if (const std::optional<AimedLight> light = aim(sample_of(group, slot, p)))
        aimed_[group].emplace_back(slot, *light);
    }
    own_[slot] = rng.state();
    rng.set(of_path);
  }
  /// What the picture's own light sample brought at the vertex: it is its group's.
  void take_from_picture(size_t slot, const vec3& L);
  /// Traces the samples of the groups that the picture has not sampled.
  void trace();
  /// Takes note of light that a path finds by its direction, after its last event at p. Where the group was sampled
  /// there by itself, both techniques are weighted by how likely that chose the light.
  /// @param fields    whether the picture chose among fields that emit, too
  /// @param weighted  gives the light, weighted against light sampling that chooses its light with a probability
  void found(size_t slot, const Light& light, const dvec3& p, bool fields,
             const std::function<dvec3(double probability)>& weighted);
  /// Light of a group that `aimed` has more than `light.NAME`.
  const GroupLight& apart(size_t slot, size_t group) const { return apart_[slot * w_.groups + group]; }

 private:
  /// Of a path's vertex in a medium, before it scattered there.
  struct Arrival {
    vec3 throughput, d;
  };

  std::span<const Light* const> lights_of(size_t group) const;
  /// Whether a vertex has a sample of its own of the group.
  bool samples(size_t slot, size_t group) const {
    return w_.sampled_group[slot] != group && first_[group] < first_[group + 1];
  }
  double probability_of_group(size_t group, const dvec3& p, bool fields) const;
  void find_shares(size_t slot, const dvec3& p, bool fields);
  /// That the picture chooses one of a group's lights, where the shares are known.
  double share_of_group(size_t slot, size_t group) const;
  LightSample sample_of(size_t group, size_t slot, const dvec3& p);
  const Medium& medium_at(size_t slot) const;
  dvec3 place_in_medium(size_t slot) const;
  bool samples_fields(size_t slot) const;
  bool aim_from_medium(size_t slot, size_t group);

  const PathContext& c_;
  PathStates& p_;
  WorldPaths& w_;
  MediaFlights& flights_;
  SurfaceEvents* surfaces_;
  const BallSamples* balls_;
  std::vector<const Light*> lights_;       // that are sampled, by group
  std::vector<bool> is_found_;             // of them: whether found() is told of it wherever a path meets it
  std::vector<size_t> first_;              // of each group's lights; behind them their number
  std::vector<GroupLight> apart_;          // by slot and group
  std::vector<bool> sampled_;              // slots, at their vertex
  std::vector<bool> knows_shares_;         // likewise: whether shares_ are those of the vertex
  std::vector<double> shares_;             // of the picture's choice, by slot and light
  std::vector<Arrival> arrival_;           // of the slots in media
  std::vector<PathGenerator::State> own_;  // of the groups' samples
  std::vector<PathGenerator::State> of_path_;
  std::vector<std::vector<std::pair<size_t, AimedLight>>> aimed_;  // from surfaces, by group: slots and samples
  SlotList hits_, met_, shadows_;
};

}  // namespace brume
