#pragma once
#include <array>
#include <deque>
#include <string>
#include <vector>

#include "filters/api/filter.h"
#include "filters/inputs/guide_layers.h"
#include "filters/regression/lattice_regression.h"

namespace brume {

/// Columns of a regression for each colour; the same planes where no guide has colour.
struct ColourColumns {
  std::array<std::vector<LatticeColumn>, 3> of;
  size_t free = 0;  ///< the first ones, which are not shrunk
  bool coloured = false;

  size_t sets() const { return coloured ? 3 : 1; }
  bool empty() const { return of[0].empty(); }
  void add(const Guide& g);
  void add(const Plane& p);
  /// To be called once no column is added any more.
  void standardise(const Plane& weight, const Task& task);
  /// The scales of the frame to clean, so that coefficients mean the same.
  void scale_like(const ColourColumns& own);
};

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

/// What is known of a frame without noise, sorted by what it may explain.
struct TransportColumns {
  ColourColumns predicted;  ///< the light that is expected, and opacity
  ColourColumns shape;      ///< that, geometry, surfaces, emission and background
  ColourColumns all;
  ColourColumns medium;         ///< all but multiple scattering
  ColourColumns few;            ///< opacity and a constant
  Plane mask;                   ///< 1 where guides know anything, or the halves differ
  std::vector<Plane> features;  ///< what tells pixels apart, each at most 1: expected light, opacity, surfaces
  Plane bright;                 ///< a first idea of the brightness
  Plane solid;                  ///< share of the pixel that shows surfaces; empty where there are none
  std::vector<Plane> solids;    ///< that, parted into edges and materials
  std::vector<std::string> names;
  bool guided = true;

  /// Points into the frame's layers.
  /// @param one  a plane of ones, which stays where it is
  TransportColumns(const FilterFrame& frame, const Plane& one, const Task& task);

  void scale_like(const TransportColumns& own);

 private:
  void add_features(const Layers& layers);
  /// What the frame itself knows of surfaces that its guides do not, as far as they are seen through the media.
  void add_surfaces(const Layers& layers, const Plane& opacity, const Task& task);
  void add_features_of(const Guide& guide, const Task& task);
  void part_solids(const std::vector<const Plane*>& normal, const std::vector<const Plane*>& materials,
                   const Task& task);

  std::deque<Plane> seen_through_;  // columns point into it
};

}  // namespace brume
