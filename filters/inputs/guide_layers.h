#pragma once
#include <stdexcept>
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

/// A channel that is read, as it is or stored.
class ChannelView {
 public:
  ChannelView(const Plane* plane) : plane_(plane) {}  // NOLINT: a plane is such a view
  explicit ChannelView(const StoredPlane* stored) : stored_(stored) {}

  int width() const { return plane_ ? plane_->width() : stored_->width(); }
  int height() const { return plane_ ? plane_->height() : stored_->height(); }
  /// The pixels from..to of a row. @param room  for so many pixels, where they may be put
  const float* row(int y, int from, int to, float* room) const {
    if (plane_) return plane_->row(y) + from;
    stored_->read(y, from, to, room);
    return room;
  }
  /// @throws std::logic_error for one that is stored
  const Plane& plane() const {
    if (!plane_) throw std::logic_error("a guide is stored that is looked up pixel by pixel");
    return *plane_;
  }

 private:
  const Plane* plane_ = nullptr;
  const StoredPlane* stored_ = nullptr;
};

/// A layer `guide.CLASS[.WHAT]` without noise: one number, three numbers, or one number for each colour.
struct Guide {
  std::string name;  ///< without the prefix
  GuideClass kind;
  bool coloured;                      ///< channels R, G, B that are not multiples of one another
  std::vector<ChannelView> channels;  ///< in their order
};

/// Every guide of a frame, by name.
std::vector<Guide> guides_of(const Layers& frame);

/// Whether a channel belongs to a guide of which transport_regression only fits sums: it may be stored.
bool is_only_fitted(std::string_view channel);

/// Whether a channel belongs to a guide.
inline bool is_guide(std::string_view channel) {
  return channel.starts_with(kGuidePrefix);
}

}  // namespace brume
