#pragma once
#include <algorithm>
#include <optional>

#include "render/guides/lit_surface.h"

namespace brume {

/// Across how many points of a light shadow rays lead, where parts of it may be hidden.
inline constexpr int kPenumbraAcross = 8;
inline constexpr int kRimPoints = 4;

/// A point near the rim of a light that has an extent, as seen from another point.
inline LightSample at_rim(const KnownLight& light, const dvec3& p, int i) {
  constexpr double kRim = 0.93;  // of what a sample's first number runs over: of the area of a round light
  const bool round = std::holds_alternative<const Sun*>(light) || base_of(light).centre();
  return base_of(light).sample(
      p, round ? dvec2(kRim, (i + 0.5) / kRimPoints) : dvec2(i % 2 ? kRim : 1 - kRim, i / 2 ? kRim : 1 - kRim));
}

/// What surfaces and other lamps leave of the light, if they leave nearly as much of all of it: asked at its rim, so
/// that penumbras are found nearly where they begin.
inline std::optional<dvec3> left_alike(const KnownLight& light, const LitSurfaces& surfaces, const dvec3& p) {
  constexpr double kAlike = 0.1;  // glass lets more or less through by the angle
  dvec3 least(1), most(0), sum(0);
  for (int i = 0; i < kRimPoints; ++i) {
    const LightSample s = at_rim(light, p, i);
    if (!(s.pdf > 0)) return {};
    const dvec3 open = surfaces.open({p, s.wi}, std::min(s.distance, kFar), base_of(light));
    least = glm::min(least, open);
    most = glm::max(most, open);
    if (max_component(most - least) > kAlike) return {};
    sum += open / double{kRimPoints};
  }
  return sum;
}

}  // namespace brume
