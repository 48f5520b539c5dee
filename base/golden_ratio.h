#pragma once

namespace brume {

/// The golden ratio less 1: points that turn by this share of a circle, or of 1, from one to the next spread evenly.
inline constexpr double kGoldenRatio = 0.6180339887498949;

}  // namespace brume
