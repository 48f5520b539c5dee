#pragma once
#include <span>
#include <vector>

#include "filters/inputs/planes.h"

namespace brume {

/// A result on each of two independent halves.
struct HalfPair {
  Rgb a, b;
};

/// x += factor * y
void add_to(Plane& x, float factor, const Plane& y, const Task& task);
void add_to(HalfPair& x, float factor, const HalfPair& y, const Task& task);

/// Luminance of the mean of both halves.
Plane brightness(const HalfPair& fit, const FrameSpace& space, const Task& task);

Rgb mean(const HalfPair& fit, const Task& task);

/// What lies within a box.
HalfPair cut(const HalfPair& from, const Box& box);

/// sum m_i(p) v_i(p) / sum m_i(p) of planes v_i and maps m_i.
Plane blend(std::span<const Plane* const> values, const std::vector<Plane>& maps, const Task& task);
/// Both halves of candidates, blended with one set of maps.
HalfPair blend(const std::vector<HalfPair>& candidates, const std::vector<Plane>& maps, const Task& task);

}  // namespace brume
