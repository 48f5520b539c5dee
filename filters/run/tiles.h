#pragma once
#include <optional>
#include <vector>

#include "filters/run/source.h"

namespace brume {

/// What is decided once for the whole frame before its tiles are filtered.
struct Run {
  const FilterSettings& filter;
  const ApplyOptions& options;
  const FeaturePlan& features;
  ivec2 frame_size;
  bool mask = false;  // whether medium and background are filtered apart
};

/// The part of the frames that is filtered at once.
struct Tile {
  Box outer, interior;                 // with its apron in the frame; without it, in the tile
  std::vector<const Layers*> sources;  // the frame to clean first
};

/// How a frame is cut, or the only box that is filtered.
struct TilePlan {
  int side, apron;  // [px]
  int across, down;
  std::optional<Box> box = {};

  int count() const { return across * down; }
  bool cuts(const Layers& frame) const {
    return count() > 1 || (box && (box->width() < frame.width() || box->height() < frame.height()));
  }
  /// One of them, its layers not yet cut out.
  Tile tile(int index, const Layers& frame) const {
    if (box) return {*box, {0, 0, box->width(), box->height()}, {}};
    const int tx = index % across, ty = index / across;
    const Box inner{tx * side, ty * side, std::min(frame.width(), (tx + 1) * side),
                    std::min(frame.height(), (ty + 1) * side)};
    const Box outer = inner.grown(apron, frame.width(), frame.height());
    return {outer, {inner.x0 - outer.x0, inner.y0 - outer.y0, inner.x1 - outer.x0, inner.y1 - outer.y0}, {}};
  }
};

/// @throws InputError when the machine has not the memory
TilePlan plan_tiles(const Run& run, const Layers& frame, const std::vector<Source>& sources);

}  // namespace brume
