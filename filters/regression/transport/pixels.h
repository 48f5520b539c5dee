#pragma once
#include <vector>

#include "filters/inputs/guide_layers.h"
#include "filters/inputs/half_pair.h"

namespace brume {

/// Which pixels are cleaned: those of which the guides know anything, or whose halves differ there or beside them;
/// without guides all.
class CleanedPixels {
 public:
  CleanedPixels(const std::vector<Guide>& guides, const Layers& layers, const RgbPlanes& half_a,
                const RgbPlanes& half_b);
  bool operator()(int x, int y) const;
  bool guided() const { return opacity_ != nullptr; }
  /// Whether the frame shows surfaces that its guides do not know.
  bool unknown_surfaces() const { return unknown_surfaces_; }

 private:
  bool is_noisy(int x, int y) const;

  const Layers& layers_;
  const Plane* opacity_ = nullptr;
  std::vector<const Plane*> surfaces_;  // what is not 0 where a surface is seen
  RgbPlanes half_a_, half_b_;
  bool unknown_surfaces_ = false;
};

/// The box of these pixels, with a margin.
Box cleaned_box(const Layers& layers, const LayerName& signal);

/// The share of each pixel that shows surfaces, and that parted into edges and materials; empty where there are none.
struct SurfaceShares {
  Plane share;
  std::vector<Plane> parts;

  SurfaceShares() = default;
  /// @param normal  of the mean over the pixel   @param materials  shares of the pixel; empty: all alike
  SurfaceShares(const std::vector<const Plane*>& normal, const std::vector<const Plane*>& materials, const Task& task);
};

/// A share of each pixel, [0, 1]: what is measured in one region says nothing about another.
struct MixingRegion {
  Plane share;
  double sure;  ///< standard errors that a gain must exceed before a result is moved
};

/// Edges and materials of surfaces, and what shows none.
std::vector<MixingRegion> regions_of(const Plane& mask, const SurfaceShares& surfaces, const Task& task);

}  // namespace brume
