#pragma once
#include <array>

#include "image/color.h"

namespace brume::kernels {

/// A row of linear RGB, Rec. 709 or what `xyz_from_rgb` is of, times `exposure` to CIE-Lab, not clipped; the definition
/// is lab_from_rgb() in image/color.h. Agrees with it to 2e-4 Lab units for values a display can show, to 1e-6 relative
/// beyond (tests/filters/kernels_test.cpp). Reads and writes up to 15 floats past `width`.
void lab_from_rgb_row(const std::array<const float*, 3>& rgb, float exposure, const std::array<float*, 3>& lab,
                      int width, const dmat3& xyz_from_rgb = xyz_from_rec709());

/// The inverse: CIE-Lab to linear RGB divided by `exposure`.
void rgb_from_lab_row(const std::array<const float*, 3>& lab, float exposure, const std::array<float*, 3>& rgb,
                      int width, const dmat3& xyz_from_rgb = xyz_from_rec709());

}  // namespace brume::kernels
