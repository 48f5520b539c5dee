#pragma once
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume {

/// Which pixels count; empty: all.
using Mask = std::vector<uint8_t>;

/// Pixels whose coverage is above zero. Empty when the frame has no coverage.
Mask medium_mask(const Layers& reference);

/// How radiance becomes the numbers that are compared.
struct LabPolicy {
  double exposure = 1.0;
  bool clip = true;  ///< to [0, 1] after exposure, as a display does; without it one firefly decides the number
  std::string text() const;
};

/// Errors of a picture against a reference, over the pixels of a mask.
struct Errors {
  double lab_rms =
      0;  ///< clipped as LabPolicy says: sqrt(mean dL^2 + da^2 + db^2), equation 3 of the gradient-kernel paper
  double lab_rms_unclipped = 0;
  double mse = 0;                ///< channel mean
  double rel_mse = 0;            ///< mean (x - r)^2 / (r^2 + 0.01), channel mean
  double rel_mse_trimmed = 0;    ///< the same without the worst 0.1 % of pixels
  double log_luminance_mse = 0;  ///< of ln max(Y, 1e-4), Y = .265 R + .670 G + .065 B: the extended-bilateral paper's
  double relative_bias = 0;      ///< mean(x) / mean(r) - 1: energy lost or gained
  size_t pixels = 0;
};

/// @param second  another, independent reference: the squared errors become products (x - r1)(x - r2), whose
/// expectation
///                is free of the references' noise; an estimate below zero is reported as 0
/// @throws std::logic_error for other sizes; InputError when a picture has NaN or infinite pixels
Errors compare(const RgbPlanes& x, const RgbPlanes& reference, const LabPolicy& policy, const Mask& mask = {},
               const RgbPlanes* second = nullptr);

/// The Lab RMS alone, prepared for many pictures against one reference pair: what tuning calls thousands of times.
class LabRms {
 public:
  LabRms(const RgbPlanes& reference, const RgbPlanes* second, const LabPolicy& policy, const Mask& mask);
  /// Mean squared error with the references' noise taken off; may be slightly negative for a perfect picture.
  double squared(const RgbPlanes& x) const;
  double operator()(const RgbPlanes& x) const;
  /// Lab distance to the reference at every pixel.
  Plane error_map(const RgbPlanes& x) const;

 private:
  std::array<Plane, 3> to_lab(const RgbPlanes& rgb) const;

  LabPolicy policy_;
  Mask mask_;
  size_t pixels_ = 0;
  std::array<Plane, 3> first_, second_;  // Lab; the same where there is one reference
};

/// Names and values in the order reports print them.
std::vector<std::pair<std::string, double>> listed(const Errors& errors);

/// Mean and half width of the two-sided 95 % confidence interval of the mean, by Student's t.
struct MeanInterval {
  double mean = 0, half_width = 0;
  size_t count = 0;
};
MeanInterval mean_interval(const std::vector<double>& values);

}  // namespace brume
