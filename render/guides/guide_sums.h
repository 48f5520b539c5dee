#pragma once
#include <algorithm>
#include <array>
#include <vector>

#include "base/vec.h"
#include "render/guides/ray_march.h"

namespace brume {

/// What a pixel's rays gather of the light of one group. Doubles alone: guide_layers.cpp finds a member by its offset.
struct GroupSums {
  double single = 0;               ///< scattered once; of light from surfaces: for the first time in the media
  std::array<double, 3> octave{};  ///< the same with a half, a quarter, an eighth of extinction and anisotropy
  std::array<double, 4> soft{};    ///< the same scattered evenly, with less and less extinction towards the light
  double forward = 0;              ///< scattered again, but by forward peaks alone
  std::array<double, 6> orders{};  ///< scattered more often, as SolvedLight::kFirstOrder divides it
  double flux = 0;                 ///< how the last of these changes along the ray
  std::array<double, 3> tail{};    ///< the last of these with a half, a quarter, an eighth of the extinction
};

/// What one pixel gathers of everything else.
struct GuideTotals {
  double opacity = 0, depth = 0, depth2 = 0, spread = 0, density = 0;
  dvec3 gradient{0};
  vec3 emission{0}, emission_once{0}, behind{0}, background{0};
  vec3 normal{0}, surface_albedo{0}, material{0}, indirect{0}, mirrored{0}, mirrored_indirect{0};
  double surface_depth = 0;
  dvec3 tinted_direct{0}, tinted_indirect{0};  ///< light of media of unlike tints, in all colours
};

/// What one pixel gathers; every ray adds to it.
struct GuideSums : GuideTotals {
  std::vector<GroupSums> groups;
  std::vector<vec3> surface;  ///< by group: reflected by a surface
  /// NodeFields times the weight of what is seen of them, with the whole extinction and without the forward peak.
  std::array<float, MarchedFields::kMost> plain{}, scaled{};
  std::vector<MarchedRay::FieldSums> fields;  ///< by group

  explicit GuideSums(size_t group_count) : groups(group_count), surface(group_count, vec3(0)), fields(group_count) {}
  void clear() {
    static_cast<GuideTotals&>(*this) = {};
    std::fill(groups.begin(), groups.end(), GroupSums{});
    std::fill(surface.begin(), surface.end(), vec3(0));
    std::fill(fields.begin(), fields.end(), MarchedRay::FieldSums{});
    plain.fill(0);
    scaled.fill(0);
  }
};

}  // namespace brume
