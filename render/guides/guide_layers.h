#pragma once
#include <array>
#include <memory>
#include <vector>

#include "image/guide_names.h"
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
    std::vector<std::string> light_groups = {};
    std::string group_of_background = {};  ///< empty: of several
  };
  /// Adds them to a frame. What does not depend on the colour is left to the first of several.
  GuideLayers(Layers& frame, const std::vector<std::unique_ptr<GuideLight>>& lights, GuideColour colour,
              const Contents& contents);

  /// @param share  of the sums that a pixel gets: 1 / rays
  void store(int x, int y, const GuideSums& sums, double share) const;

 private:
  using Planes = std::array<Plane*, 3>;  // null for what is not recorded
  template <class Value>
  struct Recorded {
    Planes planes;
    Value value;
    size_t group = 0;
  };
  /// @param channel  the only one that there is light of, or kGrey
  Planes add(Layers& frame, const GuideName& name, const GuideLight* light = nullptr, bool once = false) const;
  /// Light of all guide lights, or of a light group's as far as it is known to be theirs.
  dvec3 predicted_direct(const GuideSums& sums) const;
  dvec3 predicted_indirect(const GuideSums& sums) const;
  dvec3 predicted_direct_of(const std::string& group, const GuideSums& sums) const;
  dvec3 predicted_indirect_of(size_t group, const GuideSums& sums) const;
  void add_direct_of(size_t light, const GuideSums& sums, vec3& sum) const;
  void add_indirect_of(size_t light, const GuideSums& sums, vec3& sum) const;

  const std::vector<std::unique_ptr<GuideLight>>& lights_;
  const GuideColour colour_;
  const Contents contents_;
  std::vector<Recorded<dvec3 (*)(const GuideSums&)>> layers_;
  std::vector<Recorded<double (*)(const GroupSums&)>> group_layers_;
  std::vector<Planes> surface_;  // by group
  Planes direct_, indirect_;
  std::vector<std::array<Planes, 2>> predicted_;  // direct and indirect light, by light group
};

}  // namespace brume
