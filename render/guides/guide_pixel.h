#pragma once
#include <array>
#include <vector>

#include "render/guides/forward_peak.h"
#include "render/guides/guide_march.h"
#include "render/guides/media_line.h"
#include "render/guides/order_tint.h"

namespace brume {

/// What is kept while one pixel is marched.
struct GuideMarch::Pixel {
  explicit Pixel(const GuideMarch& march)
      : sums(march.fields_.lights().size(), march.node_fields_.count()), views(march.fields_.lights().size()) {
    for (const GuideMedia& media : march.media_) lines.emplace_back(media, march.colour_);
  }

  /// The light of one group, as it turns towards the eye.
  struct View {
    std::array<double, 4> phase{};  ///< with the mean cosine, a half, a quarter, an eighth of it
    ForwardPeak peak;
    double g = 0;                    ///< that those of a sun were made for on this ray
    double single = 0, forward = 0;  ///< what the piece that was added last has of it
    SunDepth::Line sun;              ///< the ray in the lattice of a sun's depth
  };

  GuideSums sums;
  std::vector<View> views;       // by group
  std::vector<MediaLine> lines;  // by time of the shutter
  OrderTint tint;                // the last one of media of unlike tints
};

/// A piece of a ray whose light is looked up once: weights of what is seen of it, with the extinction, a half, a
/// quarter, an eighth of it, and without the forward peak; and means over it.
struct GuideMarch::Piece {
  double begin = 0, end = 0;  // of the ray
  double w = 0, w2 = 0, w4 = 0, w8 = 0, scaled = 0;
  double thickness = 0, distance = 0, depth = 0, albedo = 0, g = 0;  // the last four times thickness
  dvec3 tint{0};                                                     // the same times albedo
  /// Joins the piece that follows.
  void add(const Piece& next) {
    if (!(thickness > 0)) begin = next.begin;
    end = next.end;
    w += next.w;
    w2 += next.w2;
    w4 += next.w4;
    w8 += next.w8;
    scaled += next.scaled;
    thickness += next.thickness;
    distance += next.distance;
    depth += next.depth;
    albedo += next.albedo;
    g += next.g;
    tint += next.tint;
  }
};

}  // namespace brume
