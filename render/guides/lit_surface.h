#pragma once
#include "render/guides/light_fields.h"

namespace brume {

/// Radiance that a surface reflects of a group's light, once, towards where a ray came from: lit through the media,
/// with shadows of surfaces; metals show highlights, and of the sky what they mirror.
/// @param sky     of the fields
/// @param colour  of the fields; in a grey one the group's own colour is applied
dvec3 reflected_light(const GroupLight& group, const SkyShares& sky, const Lattice& lattice, const Lights& lights,
                      const Surfaces& surfaces, GuideColour colour, const Ray& ray, const SurfaceHit& hit);

}  // namespace brume
