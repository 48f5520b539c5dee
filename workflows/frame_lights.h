#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "image/exr_io.h"
#include "image/foreign.h"
#include "workflows/host.h"
#include "workflows/mix_lights.h"

namespace brume {

/// A picture in a frame of whichever program, and the light groups that it is the sum of.
struct FrameLights {
  struct Group {
    std::string name;
    ChannelTriple channels;
  };
  ChannelTriple picture;
  std::vector<Group> groups;
  bool whole = false;  ///< they make up the picture; else what they leave of it stays as it is

  std::vector<std::string> names() const;
  /// One colour of the picture as it would be with other lights.
  /// @param plane_of  channels by their names
  template <class PlaneOf>
  Plane mixed(const LightMix& mix, size_t colour, const PlaneOf& plane_of) const;
};

/// The picture of another program's frame: that of its map, or the first one that is recognised. Nothing where there is
/// none, or where brume wrote the frame and no map is given.
/// @throws InputError: as read_map
std::optional<ForeignFrame> picture_in(const ExrInfo& file, const std::filesystem::path& map);

/// The pictures of a frame that are known by light group, what is on top first: of brume's also the noisy one.
/// @param foreign  as picture_in() has it
std::vector<FrameLights> lights_in(const ExrInfo& file, const std::optional<ForeignFrame>& foreign);

/// A frame of whichever program as it would be with other lights. Brume's: mix_lights. Of another program's the picture
/// and its groups, also as R, G, B on top, and what is no part of its light.
/// @throws InputError: no groups, or not one that is named; as read_frame
Layers mixed_frame(const ExrFile& file, const std::filesystem::path& map, const LightMix& mix, const Host& host);
/// The same of a frame in memory, whose channels have the names that its program gave them.
Layers mixed_frame(const Layers& frame, const LightMix& mix);

template <class PlaneOf>
Plane FrameLights::mixed(const LightMix& mix, size_t colour, const PlaneOf& plane_of) const {
  const Plane& all = plane_of(picture[colour]);
  std::vector<std::pair<const Plane*, double>> parts;
  for (const Group& group : groups) {
    const auto found = mix.find(group.name);
    const double factor = found == mix.end() ? 1 : found->second[static_cast<int>(colour)];
    parts.emplace_back(&plane_of(group.channels[colour]), whole ? factor : factor - 1);
  }
  Plane sum(all.width(), all.height());
  for (int y = 0; y < all.height(); ++y)
    for (int x = 0; x < all.width(); ++x) {
      double light = whole ? 0 : static_cast<double>(all(x, y));
      for (const auto& [part, factor] : parts) light += factor * static_cast<double>((*part)(x, y));
      sum(x, y) = static_cast<float>(light);
    }
  return sum;
}

}  // namespace brume
