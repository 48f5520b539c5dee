#pragma once
#include <vector>

#include "filters/patch/selection.h"

namespace brume {

/// Brightness below this share of the mean counts as that much where a division is at stake.
inline constexpr float kDark = 0.1f;

/// x += factor * y
void add_to(Plane& x, float factor, const Plane& y, const Task& task);

double sum_of(const Plane& plane);

/// Local weighted means: of targets / base where both are summed first.
/// @param window  deviation of a Gaussian [px]
std::vector<Plane> local_ratio(const std::vector<const Plane*>& targets, const Plane& base, const Plane& weight,
                               double window, const Task& task);

/// Luminance of the mean of both halves.
Plane brightness(const HalfPair& fit, const Task& task);

Rgb mean(const HalfPair& fit, const Task& task);

/// What lies within a box.
HalfPair cut(const HalfPair& from, const Box& box);

}  // namespace brume
