#pragma once
#include <array>
#include <vector>

#include "base/progress.h"
#include "render/guides/cap_phase.h"
#include "render/guides/guide_media.h"
#include "render/guides/light_fields.h"
#include "render/world/camera.h"

namespace brume {

/// Fields at the nodes of a lattice, all of a node's side by side, so that one look-up brings them all.
struct NodeTable {
  static constexpr size_t kMost = 128;  ///< fields; arrays of sums of them have room for so many

  NodeTable() = default;
  NodeTable(const Lattice& nodes, size_t fields)
      // Vectors of fields are read beyond those of the last node.
      : lattice(nodes),
        count(fields),
        values(static_cast<size_t>(nodes.n.x) * nodes.n.y * nodes.n.z * fields + kMost) {}
  float* node(int x, int y, int z) {
    return values.data() + ((static_cast<size_t>(x) * lattice.n.y + y) * lattice.n.z + z) * count;
  }

  Lattice lattice;
  size_t count = 0;
  NodeValues values;  ///< x slowest
};

/// The light that leaves each node of the lattice towards the eye: the fields of all groups.
class NodeFields {
 public:
  /// Where a group's fields lie among all.
  struct Slots {
    size_t orders = 0;                 ///< one for each of GuideLight::kFirstOrder
    size_t flux = 0;                   ///< change of the last one along the view
    size_t single = 0, forward = 0;    ///< scattered once; once or by forward peaks alone. Not of SharpLight
    size_t root = 0, fourth_root = 0;  ///< of the sky's transmittances
    size_t tail() const { return orders + GuideLight::kFirstOrder.size() - 1; }
  };

  /// @param media   at the time at which the light was solved first
  /// @param moving  whether rays meet the media where they are at other times, too
  /// @throws std::logic_error for more than NodeTable holds: guide_lights() limits them
  NodeFields(const LightFields& fields, const GuideMedia& media, GuideColour colour, const Camera& camera, bool moving,
             const Task& task);

  const NodeTable& table() const { return table_; }
  const std::vector<Slots>& slots() const { return slots_; }

 private:
  struct Sky;
  void fill_node(const ivec3& node, const Camera& camera, const Sky& sky);
  double scattered_once(const GuideLight& light, size_t node, const dvec3& p, const dvec3& view) const;

  const LightFields& fields_;
  const GuideMedia& media_;
  const GuideColour colour_;
  CapPhase cap_phase_;  // of the only medium
  std::vector<CapPhases> phases_;
  std::vector<Slots> slots_;
  NodeTable table_;
};

/// Light that leaves the nodes of the coarse lattice in any direction, for rays that go on from metals and glass: the
/// mean and the parts along x, y and z, each red, green and blue; of light scattered once, but for suns and lamps with
/// guides of their own, then of light scattered more often.
NodeTable any_direction(const LightFields& fields, const GuideMedia& media, GuideColour colour, const Task& task);
/// What of such fields goes along a ray's direction back to where it starts.
/// @param first  of them: kOnce or kOften
inline constexpr size_t kOnce = 0, kOften = 12;
dvec3 backwards(const std::array<float, NodeTable::kMost>& fields, size_t first, const dvec3& direction);

}  // namespace brume
