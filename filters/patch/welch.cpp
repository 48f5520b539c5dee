#include <algorithm>
#include <cmath>

#include "filters/api/registry.h"
#include "filters/inputs/samples.h"
#include "filters/patch/neighbourhood.h"
#include "filters/patch/student.h"

namespace brume {
namespace {

struct Welch {
  int search_radius = 20;
  float sigma_spatial = 3;
  float significance = 5e-4f, lambda = 0.5f;
  float sigma_albedo = 0.02f, sigma_direction = 0.1f, sigma_other = 0.1f;
};

double box_cox(double x, double lambda) {
  x = std::max(x, 0.0);
  return lambda > 1e-4 ? (std::pow(x, lambda) - 1) / lambda : std::log(x + 1e-6);
}

/// Of each pixel's samples after the transformation: the mean, corrected for skewness, its variance, how many they are.
struct Estimands {
  Rgb mean, variance;
  double samples = 8;
};

Estimands estimands(const Welch& p, const FilterFrame& frame, RepairedPixels* repaired) {
  Estimands e;
  for (size_t c = 0; c < 3; ++c) e.mean[c] = e.variance[c] = Plane(frame.width(), frame.height());
  std::vector<double> values;
  visit_samples(frame, repaired, [&](int x, int y, std::span<const vec3> samples) {
    const double n = e.samples = static_cast<double>(samples.size());
    for (size_t c = 0; c < 3; ++c) {
      values.clear();
      double mean = 0, squares = 0, cubes = 0;
      for (const vec3& sample : samples) {
        values.push_back(box_cox(frame.exposure * sample[static_cast<int>(c)], p.lambda));
        mean += values.back() / n;
      }
      for (const double v : values) {
        squares += (v - mean) * (v - mean);
        cubes += (v - mean) * (v - mean) * (v - mean);
      }
      const double variance = n > 1 ? squares / (n - 1) : 0;
      // Johnson's modified t: the skewness moves the mean by mu_3 / (6 s^2 n).
      if (variance > 1e-20) mean += cubes / n / (6 * variance * n);
      e.mean[c](x, y) = static_cast<float>(mean);
      e.variance[c](x, y) = n > 1 ? static_cast<float>(variance / n + 1e-12) : 1e30f;
    }
  });
  return e;
}

void run(const Welch& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  Estimands e = estimands(p, frame, out.repaired);
  // |mean_p - mean_q| <= t sqrt(V_p + V_q), where both pixels have the same number of samples.
  const double dof = std::max(1.0, 2 * e.samples - 2);
  const double t = student_quantile(1 - static_cast<double>(p.significance), dof);
  WeightModel model;
  Membership test;
  test.bound = Membership::Bound::kSum;
  for (size_t c = 0; c < 3; ++c) {
    for_each_row(frame.height(), quiet(task), [&](int y) {
      for (float& v : e.variance[c].pixels(y)) v *= static_cast<float>(t * t);
    });
    test.value.push_back(&e.mean[c]);
    test.centre.push_back(&e.mean[c]);
    test.squared_bound.push_back(&e.variance[c]);
  }
  model.memberships.push_back(test);
  for (const Feature& f : *frame.features) {
    const float sigma = f.name == "albedo"                           ? p.sigma_albedo
                        : f.name == "gradient" || f.name == "normal" ? p.sigma_direction
                                                                     : p.sigma_other;
    if (!(sigma > 0)) continue;
    Distance d;
    d.kind = Distance::Kind::kRatio;
    d.guide = pointers(f.mean);
    d.floor = 2 * sigma;
    model.distances.push_back(d);
  }
  std::vector<Plane> clean =
      weighted_average(model, gaussian_window(p.search_radius, p.sigma_spatial), frame.values, task).values;
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(clean[c]);
}

const FilterEntry entry =
    declare<Welch>("welch", "Joint bilateral filter over the pixels that a t-test cannot tell from the centre.")
        .merit(3.2, "to compare with: a t-test on `--buckets` or `--records` of every sample")
        .source("Sakai, Freude, Auzinger, Hahn and Wimmer 2024, A Statistical Approach to Monte Carlo Denoising")
        .notes(
            "A neighbour counts when Welch's test of the Box-Cox transformed samples, corrected for skewness, does not tell it from the centre in any channel. With `--records` every sample is transformed, as published; without, the eight bucket means are, which are closer to normal and fewer. The weights of the features are Gaussians, their variances the parameters.")
        .paper("sigma-spatial=10,significance=0.005")
        .statistics(Statistics::kBuckets)
        .can_use_records()
        .features()
        .carries()
        .param("search-radius", &Welch::search_radius, {0, 40}, "px", "half width of the window")
        .param("sigma-spatial", &Welch::sigma_spatial, {0, 100}, "px", "of the kernel over distance; 0: off",
               {1.5, 2, 3, 5, 10})
        .param("significance", &Welch::significance, {1e-6, 0.5}, "1", "alpha of the two-sided test",
               {0.0005, 0.005, 0.05})
        .param("lambda", &Welch::lambda, {0, 1}, "1", "of the Box-Cox transformation; 0: logarithm, 1: none",
               {0.25, 0.5, 1})
        .param("sigma-albedo", &Welch::sigma_albedo, {0, 100}, "1", "variance of the kernel over albedo; 0: off")
        .param("sigma-direction", &Welch::sigma_direction, {0, 100}, "1",
               "variance of the kernel over the density gradient and the normal; 0: off", {0, 0.1, 1})
        .param("sigma-other", &Welch::sigma_other, {0, 100}, "1",
               "variance of the kernel over every other feature; 0: off", {0, 0.01, 0.1})
        .scratch(16)
        .apron([](const Welch& p) { return p.search_radius; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
