#pragma once
#include "base/vec.h"

namespace brume {

/// Linear Rec. 709 to CIE-Lab, white point D65, not clipped: the cube root goes on above 1 and the linear toe below 0,
/// so the map has an inverse. White is (100, 0, 0). Source: CIE 15; matrices and constants of IEC 61966-2-1.
dvec3 lab_from_rgb(const dvec3& rgb);
/// The same of another linear RGB, whose white is (100, 0, 0) then.
/// @param xyz_from_rgb  to X / Xn, Y, Z / Zn
dvec3 lab_from_rgb(const dvec3& rgb, const dmat3& xyz_from_rgb);
/// Linear Rec. 709 to X / Xn, Y, Z / Zn.
const dmat3& xyz_from_rec709();

/// The sRGB transfer curve of a linear value, clipped to [0, 1].
double srgb_encode(double linear);
/// Its inverse on [0, 1].
double srgb_decode(double encoded);

/// A soft shoulder for values beyond what a display shows: the identity up to middle grey, 0.18, then a hyperbola that
/// leaves it with slope 1 and reaches 1 at infinity. Both in linear light.
double filmic_shoulder(double linear);

/// The matrix both the double and the SIMD conversion use.
struct LabMatrices {
  /// Rows: X / Xn, Y, Z / Zn of linear RGB.
  static constexpr double xyz_from_rgb[3][3] = {{0.4124564 / 0.95047, 0.3575761 / 0.95047, 0.1804375 / 0.95047},
                                                {0.2126729, 0.7151522, 0.0721750},
                                                {0.0193339 / 1.08883, 0.1191920 / 1.08883, 0.9503041 / 1.08883}};
};

}  // namespace brume
