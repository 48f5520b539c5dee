#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/vec.h"
#include "render/guides/node_fields.h"

namespace brume {

/// What a pixel's rays gather of the light of one group.
struct GroupSums {
  double single = 0;               ///< scattered once; of light from surfaces: for the first time in the media
  std::array<double, 3> octave{};  ///< the same with a half, a quarter, an eighth of extinction and anisotropy
  std::array<double, 4> soft{};    ///< the same scattered evenly, with less and less extinction towards the light
  double forward = 0;              ///< scattered again, but by forward peaks alone
  std::array<double, 6> orders{};  ///< scattered more often, as GuideLight::kFirstOrder divides it
  double flux = 0;                 ///< how the last of these changes along the ray
  std::array<double, 3> tail{};    ///< the last of these with a half, a quarter, an eighth of the extinction
};

/// What one pixel gathers of everything else.
struct GuideTotals {
  double opacity = 0, depth = 0, depth2 = 0, spread = 0, density = 0;
  dvec3 gradient{0};
  vec3 emission{0}, emission_once{0}, behind{0}, background{0};
  vec3 normal{0}, surface_albedo{0}, material{0}, indirect{0};
  dvec3 mirrored{0}, mirrored_indirect{0};
  double surface_depth = 0;
  /// What the rays off a sharp metal end on; whether they end on unlike things.
  std::optional<int64_t> mirrored_end;
  bool mirrored_edge = false;
  dvec3 tinted_direct{0}, tinted_indirect{0};  ///< light of media of unlike tints, in all colours
};

/// What one pixel gathers; every ray adds to it.
struct GuideSums : GuideTotals {
  /// Of fields that GuideSums::plain and scaled do not weigh enough: by w2, w4, w8; by albedo times w and unpeaked.
  struct FieldSums {
    float tail[3] = {}, single = 0, forward = 0;
  };
  std::vector<GroupSums> groups;
  std::vector<vec3> surface;  ///< by group: reflected by a surface
  /// Fields at nodes times the weight of what is seen of them, with the whole extinction and without the forward peak.
  std::array<float, NodeTable::kMost> plain{}, scaled{};
  std::vector<FieldSums> fields;  ///< by group
  /// By light group, that of surfaces alone: indirect light that they send to the eye, and RGB shares of what they send
  /// into the media that the pixel shows.
  std::vector<vec3> from_surfaces, shares;

  explicit GuideSums(size_t group_count, size_t light_groups = 0)
      : groups(group_count),
        surface(group_count, vec3(0)),
        fields(group_count),
        from_surfaces(light_groups, vec3(0)),
        shares(light_groups, vec3(0)) {}
  void clear() {
    static_cast<GuideTotals&>(*this) = {};
    std::fill(groups.begin(), groups.end(), GroupSums{});
    std::fill(surface.begin(), surface.end(), vec3(0));
    std::fill(fields.begin(), fields.end(), FieldSums{});
    std::fill(from_surfaces.begin(), from_surfaces.end(), vec3(0));
    plain.fill(0);
    scaled.fill(0);
  }
  /// Makes what is stored of sums that rays share; once, at the end.
  void collect(const LightFields& lights, const NodeFields& nodes);
};

}  // namespace brume
