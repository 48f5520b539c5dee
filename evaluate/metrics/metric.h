#pragma once
#include <string>
#include <vector>

#include "base/progress.h"
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

/// Which value of a metric is the best.
enum class Better { kLower, kHigher, kZero };
/// "lower", "higher" or "zero".
const char* better_name(Better better);

/// Which errors are taken: those of single pixels, or those too that look around pixels, SSIM and FLIP, which cost
/// more.
enum class ErrorScope { kPixels, kAll };

/// What a metric is, once: tables, pages and programs take it from here.
struct MetricInfo {
  const char *id, *name, *unit;
  Better better;
  const char* definition;
  ErrorScope scope = ErrorScope::kPixels;  ///< that it needs
  /// Power of the standard deviation of a picture's noise with which as_error() grows: 1 for a root mean square, 2 for
  /// its square; 0: no such law is known.
  int noise_power = 0;
};
/// In the order in which reports print them; the first is the primary one.
const std::vector<MetricInfo>& all_metrics();
inline constexpr size_t kLabRms = 0;

/// A metric's value as an error that is lower for a better picture, and back: itself where lower is better, the mean
/// squared error of a PSNR, 1 - SSIM, the magnitude of a bias.
double as_error(const MetricInfo& metric, double value);
double from_error(const MetricInfo& metric, double error);

/// Errors of a picture against a reference, over the pixels of a mask; all_metrics() says what they are.
struct Errors {
  double lab_rms = 0, lab_rms_unclipped = 0;
  double mse = 0, rel_mse = 0, rel_mse_trimmed = 0, log_luminance_mse = 0;
  double psnr = 0, ssim = 0, flip = 0, hdr_flip = 0;
  double relative_bias = 0;
  size_t pixels = 0;
};

/// @param second  another, independent reference: the squared errors become products (x - r1)(x - r2), whose
/// expectation
///                is free of the references' noise; an estimate below zero is reported as 0. SSIM and FLIP are taken
///                against the mean of the two
/// @throws std::logic_error for other sizes; InputError when a picture has NaN or infinite pixels, and where the first
/// is
Errors compare(const RgbPlanes& x, const RgbPlanes& reference, const LabPolicy& policy, const Mask& mask = {},
               const RgbPlanes* second = nullptr, ErrorScope scope = ErrorScope::kAll, const Task& task = {});

/// The same over several masks at once, for the work of one.
std::vector<Errors> compare_regions(const RgbPlanes& x, const RgbPlanes& reference, const LabPolicy& policy,
                                    const std::vector<Mask>& masks, const RgbPlanes* second = nullptr,
                                    ErrorScope scope = ErrorScope::kAll, const Task& task = {});

/// A picture in CIE-Lab, as the policy has it.
std::array<Plane, 3> lab_planes(const RgbPlanes& rgb, const LabPolicy& policy);

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
  LabPolicy policy_;
  Mask mask_;
  size_t pixels_ = 0;
  std::array<Plane, 3> first_, second_;  // Lab; the same where there is one reference
};

/// Names and values in the order of all_metrics().
std::vector<std::pair<std::string, double>> listed(const Errors& errors);

/// Every number of it, exactly, and back. @throws std::exception for a text of anything else
std::string text_of(const Errors& errors);
Errors errors_of(const std::string& text);

/// Of one metric, by its place in all_metrics(), each seed's.
std::vector<double> values_of(const std::vector<Errors>& by_seed, size_t metric);

}  // namespace brume
