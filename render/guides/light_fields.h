#pragma once
#include <array>
#include <vector>

#include "base/progress.h"
#include "render/guides/lattice.h"
#include "render/guides/light_groups.h"
#include "render/guides/sun_depth.h"
#include "render/world/surfaces.h"

namespace brume {

/// Light scattered towards a direction d at every node, per extinction: values[0] + d . (values[1], values[2],
/// values[3]), the first two moments of its angular distribution.
using ScatteredLight = std::array<NodeValues, 4>;

/// The light of one group inside the media, without the camera: biased, without noise.
struct GroupLight {
  /// Orders of scattering that share a guide.
  static constexpr std::array<int, 6> kFirstOrder = {2, 3, 4, 6, 9, 13};

  LightGroup group;
  SunDepth sun;                   ///< of a sun
  NodeValues depth;               ///< of a local light: optical depth towards it
  NodeValues visible;             ///< of a sun or local light where there are surfaces: share that passes them
  ScatteredLight once;            ///< of others and the glow: scattered for the first time
  std::vector<NodeValues> sky;    ///< of the sky: radiance that arrives unscattered, for each direction of travel
  std::vector<ScatteredLight> orders;  ///< for each of kFirstOrder, up to the next; the last one is the whole tail
};

/// Single scattering's transmittances and a coarse solution of multiple scattering, order by order.
///
/// Each order is swept from the one before along 24 directions (sweep.h) on a lattice about two voxels wide. Scattering
/// is taken to second order in g: a forward peak of weight g^2 counts as not scattered, and what is left varies linearly
/// with the cosine. After twelve orders the rest is a geometric series of what the last two differ by.
/// Sources: Joseph, Wiscombe, Weinman 1976 for the forward peak; Kunasz, Auer 1988 for the sweeps.
class LightFields {
 public:
  /// @param surfaces  null where there are none. They cast shadows into the media and hide the sky; light that they
  ///                  reflect is that of a few points.
  LightFields(const GuideMedia& media, const Lights& lights, const Surfaces* surfaces, GuideColour colour,
              const Task& task);

  const Lattice& lattice() const { return lattice_; }
  const std::vector<GroupLight>& groups() const { return groups_; }
  /// What the forward peak leaves of the extinction, on average.
  double scaled_extinction() const { return scale_; }
  size_t bytes() const;

  /// Directions of travel, evenly spread.
  static const std::vector<dvec3>& directions();

 private:
  class Solver;
  /// Where surfaces stand between the sky and the media, light comes from them: their albedo times the mean sky.
  static void hide_sky(const GuideMedia& media, const Surfaces& surfaces, std::vector<double>& incoming);

  Lattice lattice_;
  std::vector<GroupLight> groups_;
  double scale_ = 1;
};

}  // namespace brume
