#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "base/progress.h"
#include "render/guides/ambient_light.h"
#include "render/guides/guide_light.h"
#include "render/guides/order_tint.h"
#include "render/guides/scattering_solver.h"
#include "render/guides/surface_light.h"
#include "render/world/surfaces.h"

namespace brume {

/// Transmittances for single scattering and a coarse solution of multiple scattering, order by order: the first five on
/// nodes half a mean free path apart (two voxels at least and four at most, at a detail of 1), as many more as matter
/// on nodes twice as far, then a geometric series of the last two.
class LightFields {
 public:
  /// @param times     the media at times of the shutter, the one that is solved in the middle
  /// @param surfaces  null where there are none. They cast shadows into the media, hide the sky, and send what lights
  ///                  them back into the media once.
  /// @param detail    nodes lie as many times closer together
  /// @param pixels    of the picture: they limit how many nodes there are
  LightFields(const std::vector<GuideMedia>& times, const Lights& lights, const Surfaces* surfaces, GuideColour colour,
              double detail, double pixels, const Task& task);

  LightFields(LightFields&&) = default;

  /// Nodes of a picture of so many pixels, at a detail of 1.
  static double most_nodes(double pixels);

  const Lattice& lattice() const { return fine_; }
  /// Of the orders from kFineGuides on.
  const Lattice& coarse_lattice() const { return coarse_; }
  const std::vector<std::unique_ptr<GuideLight>>& lights() const { return lights_; }
  /// What arrives of SkyLight::incoming; empty without a sky.
  const SkyShares& sky() const { return sky_; }
  /// Null where there are no surfaces.
  const SurfaceLight* surface_light() const { return surface_light_ ? &*surface_light_ : nullptr; }
  /// Null where there are no surfaces.
  const AmbientLight* ambient_light() const { return ambient_light_ ? &*ambient_light_ : nullptr; }
  const SkyParts& sky_parts() const { return sky_parts_; }
  /// Light groups whose light from surfaces is told apart; 0 without surfaces.
  size_t groups() const { return ambient_light_ ? ambient_light_->groups() : 0; }
  /// Nodes whose light may be asked for: those near the media.
  const std::vector<uint8_t>& near() const { return near_; }
  /// What the forward peak leaves of the extinction, on average.
  double scaled_extinction() const { return scale_; }
  size_t bytes() const;

 private:
  /// Finds a light's orders.
  void solve(GuideLight& light, const LightSolve& solving, ScatteringSolver& coarse);
  /// Adds what the media scatter of a light to the ambient light's nodes. @param fine_orders  a sum of orders
  void add_to_ambient(const GuideLight& light, const Source& fine_orders, const ScatteringSolver& fine,
                      const ScatteringSolver& coarse);
  /// The ambient light, and one more group: what surfaces send into the media of all that lights them.
  void add_surface_light(const Lights& lights, LightSolve& solving, ScatteringSolver& coarse);
  /// What the media scatter, any number of times, of light that surfaces send into them.
  AmbientLight scattered_by_media(const SurfaceLight& light, ScatteringSolver& coarse) const;

  Lattice fine_, coarse_;
  std::vector<uint8_t> near_;
  std::vector<std::unique_ptr<GuideLight>> lights_;
  std::optional<AmbientLight> ambient_light_;
  SkyParts sky_parts_;
  SkyShares sky_;
  std::optional<SurfaceLight> surface_light_;
  int sky_group_ = -1;  // of Lights::groups; -1: there are none
  GuideColour colour_ = kGrey;
  OrderTint tint_;                // of the first medium
  std::vector<vec3> node_tints_;  // while light is solved, of media of unlike tints at the ambient light's nodes
  double scale_ = 1;
};

}  // namespace brume
