#pragma once
#include <stdexcept>
#include <string>
#include <vector>

#include "image/guide_names.h"

namespace brume {

/// Guides that have one name in every frame.
namespace guide_layer {
inline constexpr LayerName opacity = guide_named("guide.opacity"), depth = guide_named("guide.depth"),
                           spread = guide_named("guide.spread"), density = guide_named("guide.density"),
                           gradient = guide_named("guide.gradient"), normal = guide_named("guide.normal"),
                           predicted_direct = guide_named("guide.predicted_direct"),
                           predicted_indirect = guide_named("guide.predicted_indirect"),
                           emission = guide_named("guide.emission"), background = guide_named("guide.background"),
                           surface_material = guide_named("guide.surface_material");
}  // namespace guide_layer

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

}  // namespace brume
