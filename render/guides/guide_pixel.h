#pragma once
#include <array>
#include <optional>
#include <vector>

#include "render/guides/forward_peak.h"
#include "render/guides/guide_march.h"
#include "render/guides/media_line.h"
#include "render/guides/order_tint.h"

namespace brume {

/// What is kept of one pixel while its rays are marched, one of them at a time.
struct GuideMarch::Pixel {
  explicit Pixel(const GuideMarch& march) : sums(march.fields_.lights().size()), views(march.fields_.lights().size()) {}

  /// The light of one group, as it turns towards the eye.
  struct View {
    std::array<double, 4> phase{};  ///< with the mean cosine, a half, a quarter, an eighth of it
    ForwardPeak peak;
    double g = 0;                    ///< that those of a sun were made for on this ray
    double single = 0, forward = 0;  ///< what the piece that was added last has of it
  };

  GuideSums sums;
  std::vector<View> views;        // by group
  OrderTint tint;                 // the last one of media of unlike tints
  std::optional<MediaLine> line;  // along the ray, where media are not looked up side by side
};

/// A piece of a ray whose light is looked up once: weights of what is seen of it, with the extinction, a half, a
/// quarter, an eighth of it, and without the forward peak; and means over it.
struct GuideMarch::Piece {
  double w, w2, w4, w8, scaled;
  double thickness;
  double distance, depth, albedo, g;  ///< of the ray [world units], optical depth before it
  dvec3 tint;                         ///< of light scattered once
};

}  // namespace brume
