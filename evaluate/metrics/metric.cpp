#include "evaluate/metrics/metric.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "evaluate/metrics/encoded.h"
#include "evaluate/metrics/flip.h"
#include "evaluate/metrics/similarity.h"
#include "filters/kernels/lab.h"

namespace brume {
namespace {

ivec2 first_not_finite(const Plane& plane) {
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x)
      if (!std::isfinite(plane(x, y))) return {x, y};
  return {};
}

void check(const RgbPlanes& x, const RgbPlanes& reference) {
  for (const RgbPlanes* p : {&x, &reference})
    for (const Plane* plane : *p) {
      if (plane->width() != reference[0]->width() || plane->height() != reference[0]->height())
        throw std::logic_error(fmt::format("pictures of {} x {} and {} x {} cannot be compared", plane->width(),
                                           plane->height(), reference[0]->width(), reference[0]->height()));
      if (const size_t bad = count_not_finite(*plane)) {
        const ivec2 first = first_not_finite(*plane);
        throw InputError(fmt::format(
            "{} pixels are NaN or infinite in a picture to compare, the first at pixel {},{}; an error measure over them would mean nothing",
            bad, first.x, first.y));
      }
    }
}

constexpr double kPsnrFloor = 1e-10;  // mean squared error of 100 dB

float log_luminance(float r, float g, float b) {
  return std::log(std::max(0.265f * r + 0.670f * g + 0.065f * b, 1e-4f));
}

/// What is summed over pixels.
enum Term { kLab, kLabOpen, kSquare, kCode, kLogLuminance, kPicture, kReference, kSsim, kFlip, kHdrFlip, kTerms };
struct Sums {
  std::array<double, kTerms> of{};
  size_t pixels = 0;
  void operator+=(const Sums& other) {
    for (size_t i = 0; i < kTerms; ++i) of[i] += other.of[i];
    pixels += other.pixels;
  }
};

/// A row of a picture in CIE-Lab.
class LabRow {
 public:
  explicit LabRow(int width) : lab_{Plane(width, 1), Plane(width, 1), Plane(width, 1)} {}
  void load(const RgbPlanes& rgb, int y, const LabPolicy& policy) {
    const int width = lab_[0].width();
    const auto top = static_cast<float>(1.0 / policy.exposure);
    for (size_t c = 0; c < 3; ++c) {
      const float* in = rgb[c]->row(y);
      float* out = lab_[c].row(0);
      for (int x = 0; x < width; ++x) out[x] = policy.clip ? std::clamp(in[x], 0.0f, top) : in[x];
    }
    kernels::lab_from_rgb_row({lab_[0].row(0), lab_[1].row(0), lab_[2].row(0)}, static_cast<float>(policy.exposure),
                              {lab_[0].row(0), lab_[1].row(0), lab_[2].row(0)}, width);
  }
  const float* operator[](size_t c) const { return lab_[c].row(0); }

 private:
  std::array<Plane, 3> lab_;
};

double lab_product(const LabRow& v, const LabRow& a, const LabRow& b, int x) {
  double sum = 0;
  for (size_t c = 0; c < 3; ++c) sum += static_cast<double>(v[c][x] - a[c][x]) * (v[c][x] - b[c][x]);
  return sum;
}

std::array<Plane, 3> mean_of(const RgbPlanes& a, const RgbPlanes& b) {
  std::array<Plane, 3> mean = {*a[0], *a[1], *a[2]};
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < mean[c].height(); ++y)
      for (int x = 0; x < mean[c].width(); ++x) mean[c](x, y) = 0.5f * (mean[c](x, y) + (*b[c])(x, y));
  return mean;
}

/// The picture as a display shows it, not yet clipped.
std::array<Plane, 3> exposed(const RgbPlanes& rgb, double exposure) {
  std::array<Plane, 3> result = {*rgb[0], *rgb[1], *rgb[2]};
  for (Plane& plane : result)
    for (int y = 0; y < plane.height(); ++y)
      for (float& v : plane.pixels(y)) v *= static_cast<float>(exposure);
  return result;
}

RgbPlanes view(const std::array<Plane, 3>& planes) {
  return {&planes[0], &planes[1], &planes[2]};
}

/// What looks around pixels, as maps; empty where it is not asked for.
struct Maps {
  Plane ssim, flip, hdr_flip;

  Maps(const RgbPlanes& x, const RgbPlanes& r1, const RgbPlanes& r2, double exposure, const Task& task) {
    const std::array<Plane, 3> reference = exposed(view(mean_of(r1, r2)), exposure), test = exposed(x, exposure);
    ssim = ssim_map(view(test), view(reference), 1.0, task);
    flip = flip_map(view(test), view(reference), task);
    hdr_flip = hdr_flip_map(view(test), view(reference), task);
  }
};

/// The mean of what is left without the worst thousandth.
double trimmed_mean(std::vector<float> values) {
  const size_t kept = values.size() - values.size() / 1000;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(kept - 1), values.end());
  double sum = 0;
  for (size_t i = 0; i < kept; ++i) sum += values[i];
  return std::max(0.0, sum / static_cast<double>(kept));
}

}  // namespace

const char* better_name(Better better) {
  constexpr const char* kNames[] = {"lower", "higher", "zero"};
  return kNames[static_cast<size_t>(better)];
}

std::string LabPolicy::text() const {
  return fmt::format("CIE-Lab (D65) of linear Rec. 709 times exposure {:.4g}{}", exposure,
                     clip ? ", clipped to [0, 1] before the conversion" : ", not clipped");
}

Mask medium_mask(const Layers& reference) {
  const Plane* coverage = reference.find(layer::coverage.channel(0));
  if (!coverage) return {};
  Mask mask;
  mask.reserve(static_cast<size_t>(coverage->width()) * coverage->height());
  for (int y = 0; y < coverage->height(); ++y)
    for (const float c : coverage->pixels(y)) mask.push_back(c > 0);
  return mask;
}

namespace {

/// A picture and its references, which may be one and the same.
struct Compared {
  const RgbPlanes &x, &r1, &r2;
  const LabPolicy& policy;
  const std::optional<Maps>& maps;
};

/// The terms of a row, pixel by pixel.
/// @param relative  takes the relative squared errors   @param add  is called with each pixel's terms
template <class Add>
void compare_row(const Compared& c, int y, float* relative, const Add& add) {
  const int width = c.x[0]->width();
  const bool two = &c.r1 != &c.r2;
  LabPolicy unclipped = c.policy;
  unclipped.clip = false;
  const auto rows = [&](const RgbPlanes& rgb) {
    std::array<LabRow, 2> lab{LabRow(width), LabRow(width)};
    lab[0].load(rgb, y, c.policy);
    lab[1].load(rgb, y, unclipped);
    return lab;
  };
  const auto lab_x = rows(c.x), lab_1 = rows(c.r1);
  const auto lab_other = two ? rows(c.r2) : std::array<LabRow, 2>{LabRow(0), LabRow(0)};
  const auto& lab_2 = two ? lab_other : lab_1;
  const double exposure = c.policy.exposure;
  for (int px = 0; px < width; ++px) {
    Sums pixel{{}, 1};
    auto& of = pixel.of;
    of[kLab] = lab_product(lab_x[0], lab_1[0], lab_2[0], px);
    of[kLabOpen] = lab_product(lab_x[1], lab_1[1], lab_2[1], px);
    double relative_product = 0;
    std::array<float, 3> v, a, b;
    for (size_t k = 0; k < 3; ++k) {
      v[k] = (*c.x[k])(px, y);
      a[k] = (*c.r1[k])(px, y);
      b[k] = (*c.r2[k])(px, y);
      const double product = (static_cast<double>(v[k]) - a[k]) * (static_cast<double>(v[k]) - b[k]);
      const double mean = 0.5 * (static_cast<double>(a[k]) + b[k]);
      of[kSquare] += product / 3;
      relative_product += product / (mean * mean + 0.01) / 3;
      const float code = srgb_code(v[k], exposure), code_a = srgb_code(a[k], exposure);
      const float code_b = two ? srgb_code(b[k], exposure) : code_a;
      of[kCode] += static_cast<double>(code - code_a) * (code - code_b) / 3;
      of[kPicture] += v[k];
      of[kReference] += mean;
    }
    relative[px] = static_cast<float>(relative_product);
    const float log_x = log_luminance(v[0], v[1], v[2]), log_a = log_luminance(a[0], a[1], a[2]);
    const float log_b = two ? log_luminance(b[0], b[1], b[2]) : log_a;
    of[kLogLuminance] = static_cast<double>(log_x - log_a) * (log_x - log_b);
    if (c.maps) {
      of[kSsim] = c.maps->ssim(px, y);
      of[kFlip] = c.maps->flip(px, y);
      of[kHdrFlip] = c.maps->hdr_flip(px, y);
    }
    add(px, pixel);
  }
}

bool counts(const Mask& mask, int x, int y, int width) {
  return mask.empty() || mask[static_cast<size_t>(y) * width + x];
}

/// @param relative  the relative squared errors of all pixels
Errors errors_of(const Sums& sums, const Plane& relative, const Mask& mask) {
  Errors e;
  e.pixels = sums.pixels;
  if (e.pixels == 0) return e;
  std::vector<float> errors;
  errors.reserve(e.pixels);
  double relative_sum = 0;
  for (int y = 0; y < relative.height(); ++y)
    for (int x = 0; x < relative.width(); ++x)
      if (counts(mask, x, y, relative.width())) {
        errors.push_back(relative(x, y));
        relative_sum += errors.back();
      }
  const auto mean = [&](Term term) { return sums.of[term] / static_cast<double>(e.pixels); };
  e.lab_rms = std::sqrt(std::max(0.0, mean(kLab)));
  e.lab_rms_unclipped = std::sqrt(std::max(0.0, mean(kLabOpen)));
  e.mse = std::max(0.0, mean(kSquare));
  e.rel_mse = std::max(0.0, relative_sum / static_cast<double>(e.pixels));
  e.rel_mse_trimmed = trimmed_mean(std::move(errors));
  e.log_luminance_mse = std::max(0.0, mean(kLogLuminance));
  e.psnr = -10 * std::log10(std::max(kPsnrFloor, mean(kCode)));
  e.ssim = mean(kSsim);
  e.flip = mean(kFlip);
  e.hdr_flip = mean(kHdrFlip);
  e.relative_bias = sums.of[kReference] != 0 ? sums.of[kPicture] / sums.of[kReference] - 1.0 : 0.0;
  return e;
}

}  // namespace

std::vector<Errors> compare_regions(const RgbPlanes& x, const RgbPlanes& r1, const LabPolicy& policy,
                                    const std::vector<Mask>& masks, const RgbPlanes* second, ErrorScope scope,
                                    const Task& task) {
  check(x, r1);
  if (second) check(*second, r1);
  const RgbPlanes& r2 = second ? *second : r1;
  const Task silent = quiet(task);
  const int width = x[0]->width(), height = x[0]->height();
  std::optional<Maps> maps;
  if (scope == ErrorScope::kAll) maps.emplace(x, r1, r2, policy.exposure, silent);
  std::vector<std::vector<Sums>> rows(static_cast<size_t>(height), std::vector<Sums>(masks.size()));
  Plane relative(width, height);
  parallel_for(height, silent, [&](int y) {
    compare_row({x, r1, r2, policy, maps}, y, relative.row(y), [&](int px, const Sums& pixel) {
      for (size_t m = 0; m < masks.size(); ++m)
        if (counts(masks[m], px, y, width)) rows[static_cast<size_t>(y)][m] += pixel;
    });
  });
  std::vector<Errors> result;
  for (size_t m = 0; m < masks.size(); ++m) {
    Sums sums;
    for (const std::vector<Sums>& row : rows) sums += row[m];
    result.push_back(errors_of(sums, relative, masks[m]));
  }
  return result;
}

Errors compare(const RgbPlanes& x, const RgbPlanes& reference, const LabPolicy& policy, const Mask& mask,
               const RgbPlanes* second, ErrorScope scope, const Task& task) {
  return compare_regions(x, reference, policy, {mask}, second, scope, task)[0];
}

namespace {

/// A metric and where its value is kept.
struct ListedMetric {
  MetricInfo info;
  double Errors::*value;
};

const std::vector<ListedMetric>& metrics() {
  static const std::vector<ListedMetric> list = {
      {{"lab_rms", "Lab RMS", "Lab", Better::kLower,
        "root mean square distance in CIE-Lab (D65) of linear Rec. 709 times the exposure, clipped to [0, 1] before the conversion; equation 3 of the gradient-kernel paper",
        ErrorScope::kPixels, 1},
       &Errors::lab_rms},
      {{"lab_rms_unclipped", "Lab RMS, unclipped", "Lab", Better::kLower, "the same without clipping",
        ErrorScope::kPixels, 1},
       &Errors::lab_rms_unclipped},
      {{"mse", "MSE", "radiance^2", Better::kLower, "mean squared error of linear RGB, mean of the channels",
        ErrorScope::kPixels, 2},
       &Errors::mse},
      {{"rel_mse", "rMSE", "1", Better::kLower,
        "mean of (x - r)^2 / (r^2 + 0.01) over pixels and channels of linear RGB", ErrorScope::kPixels, 2},
       &Errors::rel_mse},
      {{"rel_mse_trimmed", "rMSE without outliers", "1", Better::kLower,
        "the same without the worst 0.1 % of the pixels", ErrorScope::kPixels, 2},
       &Errors::rel_mse_trimmed},
      {{"log_luminance_mse", "MSE of log luminance", "1", Better::kLower,
        "mean squared error of ln max(Y, 1e-4), Y = .265 R + .670 G + .065 B", ErrorScope::kPixels, 2},
       &Errors::log_luminance_mse},
      {{"psnr", "PSNR", "dB", Better::kHigher,
        "-10 log10 of the mean squared error of the sRGB-encoded picture, times the exposure and clipped to [0, 1], mean of the channels; at most 100",
        ErrorScope::kPixels, 2},
       &Errors::psnr},
      {{"ssim", "SSIM", "1", Better::kHigher,
        "structural similarity (Wang et al. 2004) of the sRGB-encoded luma, Gaussian windows of 11 x 11 pixels, against the mean of the references",
        ErrorScope::kAll},
       &Errors::ssim},
      {{"flip", "FLIP", "1", Better::kLower,
        "mean of FLIP (Andersson et al. 2020) of the picture times the exposure, clipped to [0, 1], at 67 pixels per degree, against the mean of the references",
        ErrorScope::kAll},
       &Errors::flip},
      {{"hdr_flip", "HDR-FLIP", "1", Better::kLower,
        "mean of HDR-FLIP (Andersson et al. 2021) over exposures from the reference, ACES tone curve, at 67 pixels per degree, against the mean of the references",
        ErrorScope::kAll},
       &Errors::hdr_flip},
      {{"relative_bias", "relative bias", "1", Better::kZero,
        "mean of x over mean of r, less 1: energy gained or lost"},
       &Errors::relative_bias}};
  return list;
}

}  // namespace

const std::vector<MetricInfo>& all_metrics() {
  static const std::vector<MetricInfo> list = [] {
    std::vector<MetricInfo> infos;
    for (const ListedMetric& m : metrics()) infos.push_back(m.info);
    return infos;
  }();
  return list;
}

double as_error(const MetricInfo& metric, double value) {
  if (metric.better == Better::kHigher)
    return std::string_view(metric.unit) == "dB" ? std::pow(10, -0.1 * value) : 1 - value;
  return std::abs(value);
}

double from_error(const MetricInfo& metric, double error) {
  if (metric.better == Better::kHigher)
    return std::string_view(metric.unit) == "dB" ? -10 * std::log10(error) : 1 - error;
  return error;
}

std::vector<std::pair<std::string, double>> listed(const Errors& e) {
  std::vector<std::pair<std::string, double>> values;
  for (const ListedMetric& m : metrics()) values.emplace_back(m.info.id, e.*m.value);
  return values;
}

std::string text_of(const Errors& e) {
  std::string text = fmt::format("{}", e.pixels);
  for (const ListedMetric& m : metrics()) text += fmt::format(" {}", e.*m.value);
  return text;
}

Errors errors_of(const std::string& text) {
  const std::vector<std::string> words = split(text, ' ');
  Errors e;
  e.pixels = std::stoull(words.at(0));
  for (size_t i = 0; i < metrics().size(); ++i) e.*metrics()[i].value = std::stod(words.at(i + 1));
  return e;
}

std::vector<double> values_of(const std::vector<Errors>& by_seed, size_t metric) {
  std::vector<double> values;
  for (const Errors& e : by_seed) values.push_back(e.*metrics().at(metric).value);
  return values;
}

LabRms::LabRms(const RgbPlanes& reference, const RgbPlanes* second, const LabPolicy& policy, const Mask& mask)
    : policy_(policy), mask_(mask) {
  check(reference, reference);
  first_ = lab_planes(reference, policy_);
  if (second) check(*second, reference);
  second_ = second ? lab_planes(*second, policy_) : first_;
  const size_t all = static_cast<size_t>(first_[0].width()) * first_[0].height();
  for (size_t i = 0; i < all; ++i) pixels_ += mask_.empty() || mask_[i];
}

std::array<Plane, 3> lab_planes(const RgbPlanes& rgb, const LabPolicy& policy) {
  const int width = rgb[0]->width(), height = rgb[0]->height();
  std::array<Plane, 3> lab = {*rgb[0], *rgb[1], *rgb[2]};
  const auto top = static_cast<float>(1.0 / policy.exposure);
  for (int y = 0; y < height; ++y) {
    if (policy.clip)
      for (Plane& plane : lab)
        for (float& v : plane.pixels(y)) v = std::clamp(v, 0.0f, top);
    kernels::lab_from_rgb_row({lab[0].row(y), lab[1].row(y), lab[2].row(y)}, static_cast<float>(policy.exposure),
                              {lab[0].row(y), lab[1].row(y), lab[2].row(y)}, width);
  }
  return lab;
}

double LabRms::squared(const RgbPlanes& x) const {
  check(x, x);
  const std::array<Plane, 3> lab = lab_planes(x, policy_);
  double sum = 0;
  for (int y = 0; y < lab[0].height(); ++y) {
    const uint8_t* mask = mask_.empty() ? nullptr : &mask_[static_cast<size_t>(y) * lab[0].width()];
    for (size_t c = 0; c < 3; ++c) {
      const float *v = lab[c].row(y), *a = first_[c].row(y), *b = second_[c].row(y);
      double row = 0;
      for (int px = 0; px < lab[c].width(); ++px)
        if (!mask || mask[px]) row += static_cast<double>(v[px] - a[px]) * (v[px] - b[px]);
      sum += row;
    }
  }
  return pixels_ ? sum / static_cast<double>(pixels_) : 0.0;
}

double LabRms::operator()(const RgbPlanes& x) const {
  return std::sqrt(std::max(0.0, squared(x)));
}

Plane LabRms::error_map(const RgbPlanes& x) const {
  const std::array<Plane, 3> lab = lab_planes(x, policy_);
  Plane map(lab[0].width(), lab[0].height());
  for (int y = 0; y < map.height(); ++y)
    for (int px = 0; px < map.width(); ++px) {
      float sum = 0;
      for (size_t c = 0; c < 3; ++c) {
        const float d = lab[c](px, y) - 0.5f * (first_[c](px, y) + second_[c](px, y));
        sum += d * d;
      }
      map(px, y) = std::sqrt(sum);
    }
  return map;
}

}  // namespace brume
