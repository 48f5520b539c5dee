#pragma once
#include <functional>
#include <vector>

#include "image/layers.h"
#include "render/guides/deep_pixels.h"
#include "render/guides/guide_sums.h"
#include "render/guides/lit_surface.h"
#include "render/guides/march_scene.h"
#include "render/guides/pixel_rays.h"

namespace brume {

/// Camera rays through the light of LightFields, for one colour. PixelRays says which, GuideTile takes them through the
/// media and on from mirrors.
class GuideMarch {
 public:
  /// @param sketch  one ray for each pixel, in steps twice as long
  GuideMarch(const PathContext& context, const std::vector<GuideMedia>& media, const LightFields& fields,
             GuideColour colour, const Camera& camera, double step_voxels, bool sketch, const Task& task);

  /// Told of pixels from..to of the window that are in the frame, from any thread, one at a time.
  using Marched = std::function<void(const ivec2& from, const ivec2& to)>;
  /// Adds the layers of the pixels from `corner` on to `frame`.
  /// @param deep  takes their parts; null: none are made
  void record(const ivec2& corner, Layers& frame, const Task& task, DeepRecord* deep = nullptr) const {
    record({this}, corner, frame, task, {}, deep);
  }
  /// The same of several colours, tile by tile.
  /// @param done  null, or told of each tile; they come from the middle of the window outwards then
  static void record(const std::vector<const GuideMarch*>& colours, const ivec2& corner, Layers& frame,
                     const Task& task, const Marched& done, DeepRecord* deep = nullptr);

 private:
  friend class GuideTile;
  friend class LitPixels;
  friend class MirroredRays;

  const PathContext& context_;
  const std::vector<GuideMedia>& media_;  // by time of the shutter
  const LightFields& fields_;
  const GuideColour colour_;
  const bool sketch_;
  const PixelRays rays_;
  const LitSurfaces surfaces_;
  double reference_depth_ = 0;  // that depths are counted from
  OrderTint tint_;              // of the first medium
  NodeFields node_fields_;
  NodeTable node_light_;            // of any direction; without values where no surface mirrors or refracts
  std::vector<MarchScene> scenes_;  // by time of the shutter
};

}  // namespace brume
