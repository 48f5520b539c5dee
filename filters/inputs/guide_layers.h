#pragma once
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume {

/// What every name of a guide layer begins with.
inline constexpr std::string_view kGuidePrefix = "guide.";

/// Guides that have one name in every frame (render/guides); all but the normal are weighted by what covers a pixel.
namespace guide_layer {
inline constexpr LayerName opacity{"guide.opacity", "Y", "1 - transmittance"};
inline constexpr LayerName depth{"guide.depth", "Z", "mean depth of what covers the pixel, from the picture's mean"};
inline constexpr LayerName spread{"guide.spread", "Z", "standard deviation of that depth"};
inline constexpr LayerName density{"guide.density", "Y", "mean density"};
inline constexpr LayerName gradient{"guide.gradient", "XYZ", "mean direction of the density's gradient"};
inline constexpr LayerName predicted_direct{"guide.predicted_direct", "RGB", "light scattered at most once"};
inline constexpr LayerName predicted_indirect{"guide.predicted_indirect", "RGB", "light scattered twice or more"};
inline constexpr LayerName emission{"guide.emission", "RGB", "the medium's own emission"};
inline constexpr LayerName background{"guide.background", "RGB", "lights and sky seen through the medium"};
inline constexpr LayerName normal{"guide.normal", "XYZ", "of the first surface"};
inline constexpr LayerName surface_material{"guide.surface_material", "RGB", "shares of diffuse, metal and glass"};
}  // namespace guide_layer

/// What a guide says about a pixel, by the second word of its name. Materials tell pixels apart and explain no light.
enum class GuideClass {
  kOpacity,
  kSingle,
  kMultiple,
  kEmission,
  kBackground,
  kSurface,
  kGeometry,
  kPredicted,
  kMaterial
};

/// A layer `guide.CLASS[.WHAT]` without noise: one number, three numbers, or one number for each colour.
struct Guide {
  std::string name;  ///< without the prefix
  GuideClass kind;
  bool coloured;                       ///< channels R, G, B that are not multiples of one another
  std::vector<const Plane*> channels;  ///< in their order
};

/// Every guide of a frame, by name.
std::vector<Guide> guides_of(const Layers& frame);

/// Whether a channel belongs to a guide.
inline bool is_guide(std::string_view channel) {
  return channel.starts_with(kGuidePrefix);
}

}  // namespace brume
