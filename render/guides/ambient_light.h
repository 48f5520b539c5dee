#pragma once
#include <array>
#include <vector>

#include "base/progress.h"
#include "render/guides/guide_media.h"
#include "render/guides/lattice.h"
#include "render/guides/probe_grid.h"
#include "render/world/lights.h"
#include "render/world/surfaces.h"

namespace brume {

/// Light from all around, as surfaces meet it: the sky's, what media emit, and what the media scatter, on a grid of
/// probes in a box around the media, marched in fixed directions through nodes. Surfaces hide what lies behind them;
/// glass is looked through unbent.
class AmbientLight {
 public:
  /// What a node sends out, per spacing.
  struct Node {
    float extinction = 0;               ///< without the forward peak
    std::array<float, 3> emitted{};     ///< RGB, the same in every direction
    std::array<float, 12> scattered{};  ///< RGB of the mean, and of the parts along x, y and z
  };

  /// @param scale  what the forward peak leaves of the extinction
  AmbientLight(const GuideMedia& media, const Lattice& lattice, double scale);

  std::vector<Node>& nodes() { return nodes_; }
  size_t index(int x, int y, int z) const { return (static_cast<size_t>(x) * lattice_.n.y + y) * lattice_.n.z + z; }
  /// Finds what of the nodes' and the sky's light is at the probes; called again when nodes have got more of it.
  void gather(const Surfaces& surfaces, const Environment& sky, const Task& task);

  /// RGB that a diffuse surface of albedo 1 reflects: of the sky and of emission, unscattered; and of all light that
  /// was scattered.
  struct Lit {
    dvec3 sky{0}, emitted{0}, scattered{0};
  };
  Lit onto(const dvec3& p, const dvec3& normal) const;
  /// Optical depth of the media, without the forward peak, along a part of a ray.
  double depth(const dvec3& from, const dvec3& towards, double distance) const;

 private:
  struct Probe {
    AmbientCube sky, emitted, scattered;
    AmbientCube sky_scattered;  ///< by forward peaks alone
    bool outside = true;        ///< of solids, and on the front of surfaces
  };
  /// Light that arrives at a point from a direction, of what lies nearer than a distance.
  struct Incident {
    dvec3 emitted{0}, scattered{0};
    double transmittance = 1, scaled_transmittance = 1;  ///< scaled: without the forward peak
  };
  Incident along(const dvec3& p, const dvec3& direction, double distance) const;
  const Node* node_at(const dvec3& place) const;
  void find_walls(const Surfaces& surfaces, const Task& task);
  void find_sources();
  /// How much light falls on a surface, but for shadows and a factor: what it fades by outside the probes' box.
  double strength(const dvec3& p, const dvec3& normal) const;

  Lattice lattice_;
  double scale_;
  ProbeGrid grid_;
  std::vector<Node> nodes_;
  std::vector<Probe> probes_;
  std::vector<float> walls_;  // for each probe, in each direction: how far it is to a surface
  struct Source {
    dvec3 position{0};
    double power = 0;
  };
  std::vector<Source> sources_;  // all light, gathered into a few points
};

}  // namespace brume
