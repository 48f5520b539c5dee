#include "image/color.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

constexpr double kThreshold = 216.0 / 24389.0, kKappa = 24389.0 / 27.0;

double forward(double t) {
  return t > kThreshold ? std::cbrt(t) : (kKappa * t + 16.0) / 116.0;
}

dmat3 white_relative_xyz() {
  dmat3 m;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) m[column][row] = LabMatrices::xyz_from_rgb[row][column];
  return m;
}

}  // namespace

const dmat3& xyz_from_rec709() {
  static const dmat3 matrix = white_relative_xyz();
  return matrix;
}

dvec3 lab_from_rgb(const dvec3& rgb) {
  return lab_from_rgb(rgb, xyz_from_rec709());
}

dvec3 lab_from_rgb(const dvec3& rgb, const dmat3& xyz_from_rgb) {
  const dvec3 xyz = xyz_from_rgb * rgb;
  const double fx = forward(xyz.x), fy = forward(xyz.y), fz = forward(xyz.z);
  return {116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)};
}

double filmic_shoulder(double linear) {
  constexpr double kGrey = 0.18;
  if (!(linear > kGrey)) return linear;
  return 1.0 - (1.0 - kGrey) / (1.0 + (linear - kGrey) / (1.0 - kGrey));
}

double srgb_decode(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

double srgb_encode(double linear) {
  const double v = std::clamp(linear, 0.0, 1.0);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
}

}  // namespace brume
