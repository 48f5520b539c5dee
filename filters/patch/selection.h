#pragma once
#include <span>
#include <vector>

#include "filters/inputs/half_pair.h"

namespace brume {

/// Stein's unbiased estimate of a filter's squared error at a pixel of known Gaussian noise. Source: Stein 1981.
/// @param derivative  of the filtered value by the noisy one
inline float stein_risk(float clean, float noisy, float variance, float derivative) {
  return (clean - noisy) * (clean - noisy) + 2 * variance * derivative - variance;
}

/// A picture that every pixel leaves by a twentieth of its noise, up or down. A filter's change on it, over `step`, is
/// the derivative of each pixel's result by its own value: what the neighbours do to it averages out. Source: Ramani,
/// Blu and Unser 2008, Monte-Carlo SURE.
struct Nudged {
  Rgb picture, step;
};
Nudged nudged(const RgbPlanes& noisy, const RgbPlanes& variance, ivec2 origin, const Task& task);

/// How error maps are smoothed before they are compared: non-local means with weights from the picture.
struct ErrorSmoothing {
  int search_radius, patch_radius;
  float strength;
};

/// Blends candidates by their estimated errors: the squared error of each candidate's half against the other half, less
/// that half's noise, ((B - A')^2 - 2 V + (A - B')^2 - 2 V) / 2 - (B' - A')^2 / 4, averaged over channels and smoothed;
/// the smallest wins, and the map of winners is smoothed likewise, so that no seams are seen.
/// Source: Bitterli et al. 2016, section 5.2; Rousselle, Knaus and Zwicker 2012, section 5.
/// @param variance  of the mean of both halves
HalfPair select_by_halves(const std::vector<HalfPair>& candidates, const RgbPlanes& half_a, const RgbPlanes& half_b,
                          const RgbPlanes& variance, const ErrorSmoothing& smoothing, const RgbPlanes& guide,
                          const Task& task);

/// For each candidate a map that is 1 where its error is the smallest (the first of equals), else 0.
std::vector<Plane> winners(const std::vector<Plane>& errors, const Task& task);

}  // namespace brume
