#pragma once
#include <array>
#include <vector>

#include "image/layers.h"
#include "render/guides/guide_sums.h"
#include "render/guides/light_fields.h"

namespace brume {

/// The planes of a frame that guides of one colour go to.
class GuideLayers {
 public:
  /// What of a scene has layers.
  struct Contents {
    bool emission = false, surfaces = false;
    bool mirrors = false;  ///< surfaces that mirror or refract
    bool mixed_tints = false;
    OrderTint tint = {};  ///< of the media, if there is one for all
  };
  /// Adds them to a frame. What does not depend on the colour is left to the first of several.
  GuideLayers(Layers& frame, const std::vector<SolvedLight>& lights, GuideColour colour, const Contents& contents);

  /// @param share  of the sums that a pixel gets: 1 / rays
  void store(int x, int y, const GuideSums& sums, double share) const;

 private:
  using Rgb = std::array<Plane*, 3>;  // null for what is not recorded
  /// A number of a group's sums, by its offset in doubles.
  struct Number {
    size_t group, offset;
    Plane* plane;
  };
  void add_group(Layers& frame, size_t group, const LightGroup& lights, char letter);
  vec3 predicted_direct(const GuideSums& sums) const;
  vec3 predicted_indirect(const GuideSums& sums) const;

  const std::vector<SolvedLight>& lights_;
  const GuideColour colour_;
  const Contents contents_;

  Plane* opacity_;
  std::array<Plane*, 6> once_{};  // depth, spread, gradient, density
  std::vector<Number> numbers_;
  Rgb emission_{}, emission_once_{}, behind_{}, background_{}, direct_{}, indirect_{};
  Rgb surface_albedo_{}, surface_indirect_{}, mirrored_{}, mirrored_indirect_{}, normal_{}, material_{};
  std::vector<Rgb> surface_;  // by group
  Plane* surface_depth_ = nullptr;
};

}  // namespace brume
