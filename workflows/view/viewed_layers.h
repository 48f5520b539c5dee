#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "image/layers.h"
#include "workflows/mix_lights.h"

namespace brume {

/// Names of layers that are looked at which are no layers of a frame.
inline const std::string kViewedPicture = "picture", kViewedAlpha = "alpha";

/// What of a frame makes up a layer that is looked at, lights mixed.
class ViewedLayer {
 public:
  /// @param layer      a name of ViewSceneText::layers, or "alpha"
  /// @param predicted  the frame holds guides alone: the picture is what they predict
  /// @param mix        of light groups; those that the frame knows
  ViewedLayer(const Layers& frame, const std::string& layer, bool predicted, const LightMix& mix);

  /// There is no such layer in the frame.
  bool empty() const { return whole_.empty(); }
  size_t channel_count() const { return whole_.empty() ? 0 : whole_[0].size(); }
  /// What the first channels are called that it is added up of.
  const std::vector<std::string>& channels() const { return whole_[0]; }
  /// Every channel of the frame that it needs.
  std::vector<std::string> sources() const;
  /// It is light and the mix is asked for, but the frame does not know it by light group: lights are as rendered.
  bool misses_mix() const { return misses_mix_; }
  /// One of its channels. Mixed it is the whole times what the mix makes of the sum of its groups, so that what no
  /// group holds (light that guides know of all lights together alone) is scaled as the rest of the pixel is; where a
  /// pixel's groups are black, as the groups of all pixels are.
  Plane plane(const Layers& frame, size_t channel) const;

 private:
  using Sets = std::vector<std::vector<std::string>>;  // of channels, which are added up
  struct Group {
    dvec3 factor;
    Sets sets;
  };
  void mix_groups(const Layers& frame, const std::string& layer, bool predicted, const LightMix& mix);

  Sets whole_;
  std::vector<Group> groups_;  // empty: as it is
  bool misses_mix_ = false;
};

/// The light groups that a frame knows of: rendered, clean, or predicted.
std::vector<std::string> viewed_light_groups(const Layers& frame);

}  // namespace brume
