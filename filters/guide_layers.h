#pragma once
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume {

/// What every name of a guide layer begins with.
inline constexpr std::string_view kGuidePrefix = "guide.";

/// What a guide says about a pixel, by the second word of its name.
enum class GuideClass { kOpacity, kSingle, kMultiple, kEmission, kBackground, kSurface, kGeometry, kPredicted };

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
