#pragma once
#include <cstdint>
#include <vector>

#include "image/layers.h"

namespace brume {

/// A picture as half floats for a web page, which unpacks it with the browser's own inflate (apps/page/src/half.ts).
///
/// The bits of each half become integers in the order of the values; planes are G, R - G + 32768 and B - G + 32768,
/// modulo 65536. Each value is predicted from its left, upper and upper left neighbours by the median predictor of
/// JPEG-LS (ITU-T T.87); before the first value stands 32768. Residuals are folded so that small ones of either sign
/// become small numbers; their high bytes, then their low bytes, are one zlib stream.
///
/// Values beyond the largest half, 65504, become that; NaN stays NaN.
std::vector<uint8_t> pack_half(const RgbPlanes& rgb);

/// The bits of a plane's values as half floats, row by row; values beyond the largest half become that.
std::vector<uint16_t> half_bits(const Plane& plane);

}  // namespace brume
