#pragma once
#include <functional>
#include <string>

#include "base/progress.h"
#include "image/layers.h"
#include "render/guides/deep_pixels.h"
#include "render/scene/scene.h"

namespace brume {

/// How far what is seen of a pixel moves across the picture, surfaces and media by what they cover: without noise, from
/// the march of guides. Sums over pixels of what is seen would be wrong; these are means.
namespace layer {
inline constexpr LayerName motion_previous{"motion.previous", "XY",
                                           "from here to where it was a frame earlier [px], y down"};
inline constexpr LayerName motion_next{"motion.next", "XY", "from here to where it will be a frame later [px], y down"};
}  // namespace layer

/// A scene, and what it is a frame earlier and later; where that is not known, `now` again.
struct MotionScenes {
  Scene now, previous, next;
};

/// Adds the layers motion.previous and motion.next to a frame. Camera, volumes and surfaces move as the three scenes
/// say, media also along their velocities (velocity_grid), straight on for a frame in either direction. Instances of
/// volumes and lights stand still. Where nothing covers a pixel, its background moves, infinitely far away.
/// @param say  told of what does not move though it may
/// @throws InputError: volumes, velocities and meshes that cannot be read
void add_motion(const DeepRecord& parts, MotionScenes scenes, Layers& frame,
                const std::function<void(const std::string&)>& say, const Task& task);

}  // namespace brume
