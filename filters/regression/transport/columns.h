#pragma once
#include <array>
#include <deque>
#include <string>
#include <vector>

#include "filters/inputs/filter_frame.h"
#include "filters/inputs/guide_layers.h"
#include "filters/regression/transport/lattice_regression.h"
#include "filters/regression/transport/pixels.h"

namespace brume {

/// The fits of the cascade, by their columns (columns.cpp has the table of what is in which).
enum class Fit {
  kPredicted,  ///< the light that is expected, and opacity
  kShape,      ///< that, geometry, surfaces, emission and background
  kAll,        ///< all that explains light but what is expected
  kMedium,     ///< all but multiple scattering
  kFew,        ///< opacity and a constant
};
inline constexpr size_t kFits = 5;

/// The columns of a fit for each colour; the same planes where no guide has colour.
struct ColourColumns {
  std::array<std::vector<LatticeColumn>, 3> of;
  bool coloured = false;

  size_t size() const { return of[0].size(); }
  size_t sets() const { return coloured ? 3 : 1; }
  void add(const Guide& g);
  void add(const Plane& p);
  /// To be called once no column is added any more.
  void standardise(const Plane& weight, const Task& task);
  /// The scales of the frame to clean, so that coefficients mean the same.
  void scale_like(const ColourColumns& own);
};

/// What is known of a frame without noise, sorted by what it may explain.
struct TransportColumns {
  std::array<ColourColumns, kFits> fits;
  size_t base = 0;              ///< the first columns of Fit::kAll: opacity, a constant, and what shines through
  Plane mask;                   ///< 1 where guides know anything, or the halves differ
  std::vector<Plane> features;  ///< what tells pixels apart, each at most 1
  FrameSpace space;             ///< of the frame's colours
  Plane bright;                 ///< a first idea of the brightness
  Rgb expected;                 ///< the prediction of the signal; empty where there is none
  SurfaceShares surfaces;
  std::vector<std::string> names;
  bool guided = true;

  /// Points into the frame's layers.
  /// @param one  a plane of ones, which stays where it is
  TransportColumns(const FilterFrame& frame, const Plane& one, const Task& task);

  ColourColumns& operator[](Fit fit) { return fits[static_cast<size_t>(fit)]; }
  const ColourColumns& operator[](Fit fit) const { return fits[static_cast<size_t>(fit)]; }
  void scale_like(const TransportColumns& own);

 private:
  std::deque<Plane> seen_through_;  // columns point into it
};

}  // namespace brume
