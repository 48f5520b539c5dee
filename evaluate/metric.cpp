#include "evaluate/metric.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/error.h"
#include "filters/kernels/lab.h"
#include "filters/student.h"
#include "image/color.h"

namespace brume {
namespace {

dvec3 pixel(const RgbPlanes& p, int x, int y) {
  return {(*p[0])(x, y), (*p[1])(x, y), (*p[2])(x, y)};
}

dvec3 display_lab(dvec3 rgb, const LabPolicy& policy) {
  rgb *= policy.exposure;
  return lab_from_rgb(policy.clip ? glm::clamp(rgb, 0.0, 1.0) : rgb);
}

void check(const RgbPlanes& x, const RgbPlanes& reference) {
  for (const RgbPlanes* p : {&x, &reference})
    for (const Plane* plane : *p) {
      if (plane->width() != reference[0]->width() || plane->height() != reference[0]->height())
        throw std::logic_error(fmt::format("pictures of {} x {} and {} x {} cannot be compared", plane->width(),
                                           plane->height(), reference[0]->width(), reference[0]->height()));
      if (const size_t bad = count_not_finite(*plane))
        throw InputError(fmt::format(
            "{} pixels are NaN or infinite in a picture to compare; an error measure over them would mean nothing",
            bad));
    }
}

double log_luminance(const dvec3& c) {
  return std::log(std::max(0.265 * c.x + 0.670 * c.y + 0.065 * c.z, 1e-4));
}

}  // namespace

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

Errors compare(const RgbPlanes& x, const RgbPlanes& r1, const LabPolicy& policy, const Mask& mask,
               const RgbPlanes* second) {
  check(x, r1);
  if (second) check(*second, r1);
  const RgbPlanes& r2 = second ? *second : r1;
  LabPolicy unclipped = policy;
  unclipped.clip = false;
  const int width = x[0]->width(), height = x[0]->height();
  Errors e;
  double lab = 0, lab_open = 0, bias_x = 0, bias_r = 0;
  std::vector<double> relative;
  for (int py = 0; py < height; ++py)
    for (int px = 0; px < width; ++px) {
      if (!mask.empty() && !mask[static_cast<size_t>(py) * width + px]) continue;
      ++e.pixels;
      const dvec3 v = pixel(x, px, py), a = pixel(r1, px, py), b = pixel(r2, px, py);
      const dvec3 lv = display_lab(v, policy), lo = display_lab(v, unclipped);
      lab += glm::dot(lv - display_lab(a, policy), lv - display_lab(b, policy));
      lab_open += glm::dot(lo - display_lab(a, unclipped), lo - display_lab(b, unclipped));
      e.mse += glm::dot(v - a, v - b) / 3.0;
      const dvec3 mean = 0.5 * (a + b), product = (v - a) * (v - b) / (mean * mean + 0.01);
      relative.push_back((product.x + product.y + product.z) / 3.0);
      e.log_luminance_mse += (log_luminance(v) - log_luminance(a)) * (log_luminance(v) - log_luminance(b));
      bias_x += v.x + v.y + v.z;
      bias_r += mean.x + mean.y + mean.z;
    }
  if (e.pixels == 0) return e;
  const double n = static_cast<double>(e.pixels);
  e.lab_rms = std::sqrt(std::max(0.0, lab / n));
  e.lab_rms_unclipped = std::sqrt(std::max(0.0, lab_open / n));
  e.mse = std::max(0.0, e.mse / n);
  e.log_luminance_mse = std::max(0.0, e.log_luminance_mse / n);
  e.relative_bias = bias_r != 0 ? bias_x / bias_r - 1.0 : 0.0;
  for (const double v : relative) e.rel_mse += v / n;
  const size_t kept = e.pixels - e.pixels / 1000;
  std::nth_element(relative.begin(), relative.begin() + static_cast<std::ptrdiff_t>(kept - 1), relative.end());
  for (size_t i = 0; i < kept; ++i) e.rel_mse_trimmed += relative[i] / static_cast<double>(kept);
  e.rel_mse = std::max(0.0, e.rel_mse);
  e.rel_mse_trimmed = std::max(0.0, e.rel_mse_trimmed);
  return e;
}

std::vector<std::pair<std::string, double>> listed(const Errors& e) {
  return {{"lab_rms", e.lab_rms},
          {"lab_rms_unclipped", e.lab_rms_unclipped},
          {"mse", e.mse},
          {"rel_mse", e.rel_mse},
          {"rel_mse_trimmed", e.rel_mse_trimmed},
          {"log_luminance_mse", e.log_luminance_mse},
          {"relative_bias", e.relative_bias}};
}

LabRms::LabRms(const RgbPlanes& reference, const RgbPlanes* second, const LabPolicy& policy, const Mask& mask)
    : policy_(policy), mask_(mask) {
  check(reference, reference);
  first_ = to_lab(reference);
  if (second) check(*second, reference);
  second_ = second ? to_lab(*second) : first_;
  const size_t all = static_cast<size_t>(first_[0].width()) * first_[0].height();
  for (size_t i = 0; i < all; ++i) pixels_ += mask_.empty() || mask_[i];
}

std::array<Plane, 3> LabRms::to_lab(const RgbPlanes& rgb) const {
  const int width = rgb[0]->width(), height = rgb[0]->height();
  std::array<Plane, 3> lab = {*rgb[0], *rgb[1], *rgb[2]};
  const auto top = static_cast<float>(1.0 / policy_.exposure);
  for (int y = 0; y < height; ++y) {
    if (policy_.clip)
      for (Plane& plane : lab)
        for (float& v : plane.pixels(y)) v = std::clamp(v, 0.0f, top);
    kernels::lab_from_rgb_row({lab[0].row(y), lab[1].row(y), lab[2].row(y)}, static_cast<float>(policy_.exposure),
                              {lab[0].row(y), lab[1].row(y), lab[2].row(y)}, width);
  }
  return lab;
}

double LabRms::squared(const RgbPlanes& x) const {
  check(x, x);
  const std::array<Plane, 3> lab = to_lab(x);
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
  const std::array<Plane, 3> lab = to_lab(x);
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

MeanInterval mean_interval(const std::vector<double>& values) {
  MeanInterval result{0, 0, values.size()};
  if (values.empty()) return result;
  const double n = static_cast<double>(values.size());
  for (const double v : values) result.mean += v / n;
  double squares = 0;
  for (const double v : values) squares += (v - result.mean) * (v - result.mean);
  if (values.size() > 1) result.half_width = student_quantile(0.95, n - 1) * std::sqrt(squares / (n - 1) / n);
  return result;
}

}  // namespace brume
