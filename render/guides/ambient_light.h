#pragma once
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "render/guides/lattice.h"

namespace brume {

/// Light that media emit and scatter, as it arrives outside and between them: marched through nodes.
class AmbientLight {
 public:
  /// What a node sends out, per spacing.
  struct Node {
    std::array<float, 3> emitted{};     ///< RGB, the same in every direction
    std::array<float, 12> scattered{};  ///< RGB of the mean, and of the parts along x, y and z
  };

  /// @param scale   what the forward peak leaves of the extinction
  /// @param groups  light groups that are told apart
  AmbientLight(const Lattice& lattice, double scale, size_t groups = 0);

  const Lattice& lattice() const { return lattice_; }
  std::vector<Node>& nodes() { return nodes_; }
  size_t groups() const { return groups_; }
  /// The same media, which send out nothing yet, and of no groups.
  AmbientLight dark() const;
  size_t bytes() const;
  /// The group of all that media emit; nothing where it is of several.
  void set_group_of_emissions(std::optional<size_t> group) { group_of_emissions_ = group; }
  /// RGB of the mean that a node scatters of each light group.
  std::span<vec3> of_groups(size_t node) { return {of_groups_.data() + node * groups_, groups_}; }
  size_t index(int x, int y, int z) const { return (static_cast<size_t>(x) * lattice_.n.y + y) * lattice_.n.z + z; }

  /// Of each node, without the forward peak.
  std::vector<float>& extinctions() { return extinctions_; }
  float extinction(int x, int y, int z) const { return extinctions_[index(x, y, z)]; }

  /// RGB that arrives at a point from a direction, of what lies nearer than a distance.
  struct Incident {
    dvec3 emitted{0}, scattered{0};
    double transmittance = 1, scaled_transmittance = 1;  ///< scaled: without the forward peak
  };
  /// @param of_groups  gets what of Incident::scattered is of each light group, in the directions of all; or nothing
  Incident along(const dvec3& p, const dvec3& direction, double distance, std::span<dvec3> of_groups = {}) const;
  /// Optical depth of the media, without the forward peak, along a part of a ray.
  double depth(const dvec3& from, const dvec3& towards, double distance) const;

 private:
  std::optional<size_t> node_at(const dvec3& place) const;

  Lattice lattice_;
  double scale_;
  std::vector<float> extinctions_;  // apart from the rest: along many rays nothing else is read
  std::vector<Node> nodes_;
  size_t groups_;
  std::vector<vec3> of_groups_;
  std::optional<size_t> group_of_emissions_;
};

}  // namespace brume
