#include <algorithm>
#include <cmath>

#include "filters/api/registry.h"
#include "filters/patch/neighbourhood.h"
#include "filters/patch/selection.h"

namespace brume {
namespace {

struct Sbf {
  float scale = 1;
  float sigma_direction = 0, sigma_color = 1, sigma_depth = 0.6f;
};

constexpr float kScales[] = {1, 2, 4, 8};
// Least noise that features are taken to have.
constexpr float kVarianceFloor = 1e-2f;
// Spatial sigma of the cross bilateral filter that smooths the error maps.
constexpr float kErrorScale = 8;

float sigma_of(const Sbf& p, const Feature& f) {
  if (f.name == "gradient" || f.name == "normal") return p.sigma_direction;
  if (f.name == "scatter-depth" || f.name == "surface-depth") return p.sigma_depth;
  return p.sigma_color;
}

void run(const Sbf& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  std::vector<Plane> variances;
  variances.reserve(frame.features->size());
  WeightModel model;
  for (const Feature& f : *frame.features) {
    const float sigma = sigma_of(p, f);
    if (!(sigma > 0)) continue;
    variances.push_back(sum_of(f.variance));
    // The paper divides by the variance of the samples; this is what is left of it in the mean, times n.
    for_each_row(height, quiet(task), [&](int y) {
      float* v = variances.back().row(y);
      for (int x = 0; x < width; ++x) v[x] *= static_cast<float>(std::max(1.0, frame.samples_at(x, y)));
    });
    Distance d;
    d.kind = Distance::Kind::kRatio;
    d.guide = pointers(f.mean);
    d.variance = {&variances.back()};
    d.floor = kVarianceFloor;
    d.scale = 1 / (2 * sigma * sigma);
    model.distances.push_back(d);
  }
  const auto window = [&](float scale) {
    return gaussian_window(static_cast<int>(std::ceil(2 * scale)), static_cast<double>(scale));
  };
  std::vector<const Plane*> averaged(frame.signal.begin(), frame.signal.end());
  if (frame.carries()) averaged.insert(averaged.end(), frame.values.begin(), frame.values.end());

  // Stein's unbiased risk with dF/dy = 1 / sum w, because no weight depends on y.
  std::vector<Averages> candidates;
  std::vector<Plane> errors;
  const double work = 1 + 4 + 16 + 64 + 64;
  double done = 0;
  for (const float s : kScales) {
    const float scale = s * p.scale;
    const double part = s * s / work;
    candidates.push_back(weighted_average(model, window(scale), averaged, share(task, done, done + part)));
    done += part;
    const Averages& f = candidates.back();
    errors.push_back(make_plane(width, height, quiet(task), [&](int x, int y) {
      float sum = 0;
      for (size_t c = 0; c < 3; ++c)
        sum += stein_risk(f.values[c](x, y), (*frame.signal[c])(x, y), (*frame.variance[c])(x, y),
                          1 / std::max(f.weight(x, y), 1.0f));
      return sum;
    }));
  }
  errors = weighted_average(model, window(kErrorScale * p.scale), pointers(errors), share(task, done, 1)).values;
  const std::vector<Plane> won = winners(errors, task);
  const size_t offset = frame.carries() ? 3 : 0;
  for (size_t c = 0; c < 3; ++c) {
    std::vector<const Plane*> values;
    for (const Averages& f : candidates) values.push_back(&f.values[c + offset]);
    *out[c] = blend(values, won, task);
  }
}

const FilterEntry entry =
    declare<Sbf>(
        "sbf", "Cross bilateral filter over features whose width Stein's unbiased risk estimate chooses at each pixel.")
        .merit(5.6, "when time is short: within a few per cent of the best on the whole picture, several times faster")
        .source("Li, Wu and Chuang 2012, SURE-based Optimization for Adaptive Sampling and Reconstruction, section 4")
        .notes(
            "Candidates have spatial sigmas 1, 2, 4 and 8 px. Colour does not enter the weights, so that the risk has a closed form; its maps are smoothed by the widest candidate. The density gradient stands for the normal, opacity and single scattering for the texture.")
        .paper("sigma-direction=0.8,sigma-color=0.25")
        .statistics(Statistics::kVariance)
        .features()
        .carries()
        .param("scale", &Sbf::scale, {0.1, 4}, "1", "of all four spatial sigmas", {0.5, 1})
        .param("sigma-direction", &Sbf::sigma_direction, {0, 100}, "deviations",
               "of the density gradient and the normal; 0: off", {0, 0.4, 0.8, 1.6})
        .param("sigma-color", &Sbf::sigma_color, {0, 100}, "deviations",
               "of opacity, albedo and single scattering; 0: off", {0.25, 0.5, 1, 2})
        .param("sigma-depth", &Sbf::sigma_depth, {0, 100}, "deviations", "of depth; 0: off", {0.3, 0.6, 1.2})
        .scratch(50)
        .apron([](const Sbf& p) { return static_cast<int>(32 * p.scale) + 1; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
