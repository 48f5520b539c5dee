#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/inputs/planes.h"
#include "filters/window/lab_window.h"

namespace brume {
namespace {

enum class Domain { kLab, kLogLuminance };

struct ExtendedBilateral {
  Domain domain = Domain::kLab;
  int radius = 6;
  float noise_factor = 0;
  float sigma_domain = 2, sigma_range = 0;  // 0: the domain's published values, below
  Average average = Average::kLinear;
};

kernels::Bilateral weights(const ExtendedBilateral& p) {
  const bool lab = p.domain == Domain::kLab;
  return {p.sigma_domain > 0 ? p.sigma_domain
          : lab              ? 3.0f
                             : 2.0f,
          p.sigma_range > 0 ? p.sigma_range
          : lab             ? 10.0f
                            : 0.4f};
}

void run_lab(const ExtendedBilateral& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  LabWindow window(frame, p.radius, p.average, task);
  const kernels::WindowInput in = window.input();
  kernels::Bilateral w = weights(p);
  w.sigma_range = range_sigma(w.sigma_range, p.noise_factor, frame);
  WorkImage prefiltered = gaussian(window.guide(), p.radius, weights(p).sigma_domain, task);
  if (in.values != in.guide)
    for (PaddedPlane& channel : gaussian(window.values(), p.radius, weights(p).sigma_domain, task).channels)
      prefiltered.channels.push_back(std::move(channel));
  for_each_row(frame.height(), task, [&](int y) { kernels::extended_bilateral_row(in, w, prefiltered, y); });
  window.finish(out, task);
}

double radiance_luminance(double r, double g, double b) {
  return 0.265 * r + 0.670 * g + 0.065 * b;
}

/// The paper's own mode: the logarithm of Radiance's luminance is filtered, colour follows.
void run_log(const ExtendedBilateral& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  if (frame.carries())
    throw InputError(
        "filter extended_bilateral: domain=log-luminance makes colour from luminance and cannot carry other layers");
  if (p.noise_factor > 0)
    throw InputError(
        "filter extended_bilateral: noise-factor is a multiple of the noise in Lab; with domain=log-luminance give sigma-range");
  const int width = frame.width(), height = frame.height();
  Plane luminances(width, height), logarithms(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double l = radiance_luminance((*frame.signal[0])(x, y), (*frame.signal[1])(x, y), (*frame.signal[2])(x, y));
      luminances(x, y) = static_cast<float>(l);
    }
  const double lowest = 1e-4 * frame.typical_luminance;
  if (!(frame.typical_luminance > 0)) {  // black, or nothing a logarithm could take
    for (size_t c = 0; c < 3; ++c) *out[c] = *frame.signal[c];
    return;
  }
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      logarithms(x, y) = static_cast<float>(std::log(std::max<double>(luminances(x, y), lowest)));

  const Plane* guide_plane[] = {&logarithms};
  const Plane* value_planes[] = {&logarithms, frame.signal[0], frame.signal[1], frame.signal[2]};
  const WorkImage guide = padded(guide_plane, p.radius), values = padded(value_planes, p.radius);
  WorkImage result(width, height, p.radius, 4);
  WorkImage prefiltered = gaussian(guide, p.radius, weights(p).sigma_domain, task);
  for (PaddedPlane& channel : gaussian(values, p.radius, weights(p).sigma_domain, task).channels)
    prefiltered.channels.push_back(std::move(channel));
  kernels::WindowInput in{p.radius, &guide, &values, &result, nullptr, {}, {}};
  PaddedPlane medium;
  if (frame.medium) {
    const Plane* plane[] = {frame.medium};
    medium = std::move(padded(plane, p.radius).channels[0]);
    in.medium = &medium;
    // The common rule's bilateral is in Lab; in this domain the background keeps the paper's own weights, not widened.
    in.background_weights = weights(p);
  }
  for_each_row(height, task, [&](int y) {
    kernels::extended_bilateral_row(in, weights(p), prefiltered, y);
    for (int x = 0; x < width; ++x) {
      // In its domain the paper averages luminance alone, and the noisy pixel keeps its colour.
      const double clean = std::exp(static_cast<double>(result.channels[0].row(y)[x])),
                   scale = clean / std::max<double>(luminances(x, y), lowest);
      for (size_t c = 0; c < 3; ++c)
        (*out[c])(x, y) = p.average == Average::kDomain ? static_cast<float>(scale * (*frame.signal[c])(x, y))
                                                        : result.channels[c + 1].row(y)[x];
    }
  });
}

void run(const ExtendedBilateral& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  (p.domain == Domain::kLab ? run_lab : run_log)(p, frame, out, task);
}

const FilterEntry entry =
    declare<ExtendedBilateral>(
        "extended_bilateral",
        "Bilateral filter whose range kernel is centred on a Gaussian-prefiltered value, so that outliers do not vouch for themselves.")
        .merit(1.9, "over the bilateral filter where single bright pixels abound")
        .source("Xu and Pattanaik 2005, equations 5 and 6; Lab settings of Xu et al. 2011, section 3")
        .notes(
            "The paper prints sigma_r = 2, sigma_d = 0.4; taken literally they do nothing, because 0.4 px leaves 84 % of the weight on the centre. Swapped (2 px, 0.4 in log luminance) they span the 13 x 13 window the comparisons use, and are what zeros stand for with `log-luminance`; the literal pair is `sigma-domain=0.4 sigma-range=2`.")
        .paper("sigma-domain=0,average=domain")
        .param("domain", &ExtendedBilateral::domain, {"lab", "log-luminance"},
               "what is compared: CIE-Lab, or the logarithm of luminance as published")
        .param("radius", &ExtendedBilateral::radius, {0, 32}, "px", "half width of the window")
        .param("sigma-domain", &ExtendedBilateral::sigma_domain, {0, 100}, "px",
               "of the kernel over distance and the prefilter; 0: 3 (lab), 2 (log-luminance)",
               {0.5, 0.75, 1, 1.5, 2, 3, 4})
        .param("sigma-range", &ExtendedBilateral::sigma_range, {0, 1000}, "domain units",
               "of the kernel over difference; 0: 10 (lab), 0.4 (log-luminance)", {2.5, 5, 10, 20, 40, 80})
        .param("noise-factor", &ExtendedBilateral::noise_factor, {0, 100}, "deviations", kNoiseFactorHelp)
        .noise_level([](const ExtendedBilateral& p) { return p.noise_factor > 0; })
        .param("average", &ExtendedBilateral::average, kAverageNames, kAverageHelp, kAverageNames)
        .apron([](const ExtendedBilateral& p) { return 2 * p.radius; })
        .background()
        .carries()
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
