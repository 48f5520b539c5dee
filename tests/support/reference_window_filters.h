#pragma once
#include <vector>

#include "base/vec.h"
#include "filters/kernels/window.h"

namespace brume::kernels {

/// The scalar definition of the window filters, in double and written to be read: what the vector code is tested
/// against.
struct ReferenceImage {
  int width = 0, height = 0;
  std::vector<dvec3> value;     ///< the guide and the values at once, row by row
  std::vector<dvec3> gradient;  ///< unit, or zero where undefined; may be empty
  std::vector<double> opacity;  ///< may be empty
  const dvec3& at(int x, int y) const { return value[static_cast<size_t>(y) * width + x]; }
};

std::vector<dvec3> reference_gaussian(const ReferenceImage& image, int radius, double sigma);
std::vector<dvec3> reference_bilateral(const ReferenceImage& image, int radius, const Bilateral& weights);
std::vector<dvec3> reference_extended_bilateral(const ReferenceImage& image, int radius, const Bilateral& weights);
std::vector<dvec3> reference_gradient_kernel(const ReferenceImage& image, int radius, const GradientWeights& weights);
/// One pass.
std::vector<dvec3> reference_trilateral(const ReferenceImage& image, int radius, const TrilateralWeights& weights);
double reference_road(const ReferenceImage& image, int x, int y);

}  // namespace brume::kernels
