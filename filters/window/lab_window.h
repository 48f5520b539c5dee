#pragma once
#include <algorithm>

#include "filters/api/filter.h"
#include "filters/kernels/window.h"

namespace brume {

/// Where a perceptual filter averages. Its weights always come from CIE-Lab.
enum class Average {
  kDomain,  ///< in Lab, as published: averages cube roots, so noise darkens
  kLinear,  ///< in linear light: keeps the mean
};
inline const std::vector<std::string> kAverageNames = {"domain", "linear"};
inline constexpr const char* kAverageHelp = "average Lab values (as published) or linear light with weights from Lab";

inline constexpr const char* kNoiseFactorHelp =
    "range sigma as this many times the measured noise of the picture; 0: the sigma given";
/// The range sigma: what was given, or a multiple of the picture's noise, of which even none leaves a kernel.
inline float range_sigma(float given, float noise_factor, const FilterFrame& frame) {
  return noise_factor > 0 ? std::max(noise_factor * static_cast<float>(frame.lab_noise), 1e-6f) : given;
}

/// A frame on its way through window kernels: padded Lab guide, values to average, and back.
class LabWindow {
 public:
  LabWindow(const FilterFrame& frame, int radius, Average average, const Task& task);

  const WorkImage& guide() const { return lab_; }
  const WorkImage& values() const { return average_ == Average::kDomain ? lab_ : rgb_; }
  /// What a row kernel needs, set up for a pass over the frame.
  kernels::WindowInput input();
  /// Makes the result of a pass the input of the next.
  void use_result_as_guide(const Task& task);
  /// Converts the last pass's result to linear RGB.
  void finish(const FilterOutput& out, const Task& task);

 private:
  const FilterFrame& frame_;
  int radius_;
  Average average_;
  WorkImage lab_, rgb_, out_;
  PaddedPlane medium_;
};

/// Gaussian of both directions, window clipped and renormalised.
WorkImage gaussian(const WorkImage& in, int radius, float sigma, const Task& task);

/// A padded copy of channels.
WorkImage padded(std::span<const Plane* const> planes, int radius);

}  // namespace brume
