#pragma once
#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// How many pixels of the display lie in a degree of the viewer's field of view: 0.7 m from a display 0.7 m and 3840
/// pixels wide, as published.
inline constexpr double kFlipPixelsPerDegree = 67.0206;

/// FLIP: at each pixel how different two pictures look to a viewer who flips between them, in [0, 1].
///
/// Both are filtered by the eye's contrast sensitivity in an opponent colour space; the distance of the filtered
/// colours (HyAB in Hunt-adjusted CIE-Lab) is raised where edges or points differ. The picture's border is continued.
/// @param test, reference  linear Rec. 709 as the display shows it; clipped to [0, 1]. Finite, of one size
/// Source: Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom, Fairchild 2020, FLIP: A Difference Evaluator for
/// Alternating Images.  Proof: tests/evaluate/flip_test.cpp
Plane flip_map(const RgbPlanes& test, const RgbPlanes& reference, const Task& task,
               double pixels_per_degree = kFlipPixelsPerDegree);

/// The exposures, as powers of two, over which HDR-FLIP looks at pictures: from where the reference's brightest pixel
/// is shown at 85 % of white to where the median is, in steps of at most about one stop.
std::vector<double> hdr_flip_exposures(const RgbPlanes& reference);

/// HDR-FLIP: the largest FLIP error of each pixel over exposures chosen from the reference, each tone mapped with the
/// ACES curve.
/// @param test, reference  linear Rec. 709, not clipped
/// Source: Andersson, Nilsson, Shirley, Akenine-Moller 2021, Visualizing Errors in Rendered High Dynamic Range Images.
Plane hdr_flip_map(const RgbPlanes& test, const RgbPlanes& reference, const Task& task,
                   double pixels_per_degree = kFlipPixelsPerDegree);

}  // namespace brume
