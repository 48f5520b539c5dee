#pragma once
#include <vector>

#include "base/progress.h"
#include "render/guides/cap_phase.h"
#include "render/guides/guide_media.h"
#include "render/guides/light_fields.h"
#include "render/guides/ray_march.h"
#include "render/world/camera.h"

namespace brume {

/// The light that leaves each node of the lattice towards the eye: the fields of all groups interleaved, so that one
/// look-up brings them all.
class NodeFields {
 public:
  /// Where a group's fields lie among all.
  struct Slots {
    size_t orders = 0;                             ///< one for each of SolvedLight::kFirstOrder
    size_t flux = 0;                               ///< change of the last one along the view
    size_t single = 0, root = 0, fourth_root = 0;  ///< scattered once; the last two of the sky's transmittances
    size_t forward = 0;                            ///< of the sky: scattered once or by forward peaks alone
  };
  /// Of all lights together: light_groups() limits them.
  static constexpr size_t kMost = MarchedFields::kMost;

  /// @param media  at the time at which the light was solved first   @throws std::logic_error for more than kMost
  NodeFields(const LightFields& fields, const GuideMedia& media, GuideColour colour);

  void fill(const Camera& camera, const Task& task);
  /// All fields at a point, linear between the nodes. @param values  count() numbers, aligned to four
  void interpolate(const dvec3& world, float* values) const;
  size_t count() const { return count_; }
  /// As the march reads them, without groups; after fill().
  MarchedFields marched() const;
  const Slots& of(size_t group) const { return slots_[group]; }

 private:
  struct Sky;
  void fill_node(const ivec3& node, const Camera& camera, const Sky& sky);

  const LightFields& fields_;
  const GuideMedia& media_;
  const GuideColour colour_;
  CapPhase cap_phase_;  // of the only medium
  std::vector<Slots> slots_;
  size_t count_ = 0;  // a multiple of four
  NodeValues values_;
};

}  // namespace brume
