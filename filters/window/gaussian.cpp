#include <cmath>
#include <iterator>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/patch/neighbourhood.h"
#include "filters/patch/selection.h"
#include "filters/window/lab_window.h"

namespace brume {
namespace {

enum class Choose { kFixed, kPerPixel };

struct GaussianFilter {
  int radius = 6;
  float sigma = 2;
  Choose choose = Choose::kFixed;
  Average average = Average::kLinear;
};

// Widths that compete for a pixel, times sigma / 2; and the kernel that smooths their estimated errors.
constexpr double kWidths[] = {0.25, 0.5, 0.75, 1, 1.5, 2, 3, 4};
constexpr double kErrorSigma = 3;

/// The width with the smallest risk at every pixel. A Gaussian's weights do not depend on the picture, so that the
/// derivative of a pixel's result by its own value is its own weight.
void run_per_pixel(const GaussianFilter& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  if (!frame.variance[0])
    throw InputError(
        "filter gaussian: choose=per-pixel needs the variance of its layer, which the frame does not have; --noise spatial estimates it from the picture");
  std::vector<const Plane*> planes(frame.signal.begin(), frame.signal.end());
  if (frame.carries()) planes.insert(planes.end(), frame.values.begin(), frame.values.end());
  std::vector<std::vector<Plane>> candidates;
  std::vector<Plane> errors;
  for (const double width : kWidths) {
    const double sigma = width * 0.5 * static_cast<double>(p.sigma);
    std::vector<Plane>& clean = candidates.emplace_back();
    for (const Plane* plane : planes) clean.push_back(gaussian_blur(*plane, sigma, task));
    double total = 0;
    for (int j = -20; j <= 20; ++j) total += std::exp(-j * j / (2 * sigma * sigma));
    const float own = static_cast<float>(1 / (total * total));
    const Plane error = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
      float sum = 0;
      for (size_t c = 0; c < 3; ++c)
        sum += stein_risk(clean[c](x, y), (*frame.signal[c])(x, y), (*frame.variance[c])(x, y), own);
      return sum;
    });
    errors.push_back(gaussian_blur(error, kErrorSigma, task));
    task.check();
    task.report(static_cast<double>(candidates.size()) / (std::size(kWidths) + 1));
  }
  std::vector<Plane> maps;
  for (const Plane& won : winners(errors, task)) maps.push_back(gaussian_blur(won, 1, task));
  const size_t offset = frame.carries() ? 3 : 0;
  for (size_t c = 0; c < 3; ++c) {
    std::vector<const Plane*> values;
    for (const std::vector<Plane>& clean : candidates) values.push_back(&clean[c + offset]);
    *out[c] = blend(values, maps, task);
  }
  task.report(1);
}

void run(const GaussianFilter& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  if (p.choose == Choose::kPerPixel) return run_per_pixel(p, frame, out, task);
  LabWindow window(frame, p.radius, p.average, task);
  const WorkImage smooth = gaussian(window.values(), p.radius, p.sigma, task);
  const kernels::WindowInput in = window.input();
  for_each_row(frame.height(), task, [&](int y) { kernels::background_row(in, smooth, y); });
  window.finish(out, task);
}

const FilterEntry entry =
    declare<GaussianFilter>("gaussian",
                            "Plain Gaussian blur, the honest baseline: on smooth volumes a tuned one is hard to beat.")
        .merit(1.3, "for a quick look without features or statistics, and as the baseline that others must beat")
        .source("textbook; measured level with the best tuned bilateral on smooth volumes")
        .notes(
            "Averages in linear light by default, where a blur belongs. `choose=per-pixel` takes at each pixel the width among eight, from a quarter to four times half of sigma, whose estimated error is the smallest.")
        .preset("paper", "the spatial kernel of the paper's bilateral filter", "")
        .statistics(Statistics::kNone, Statistics::kVariance)
        .also_compare({"choose=per-pixel"})
        .param("radius", &GaussianFilter::radius, {0, 32}, "px", "half width of the window")
        .param("sigma", &GaussianFilter::sigma, {0, 100}, "px", "standard deviation; 0 is a box over the window",
               {0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1.2, 1.4, 1.7, 2, 2.5, 3, 4})
        .param("choose", &GaussianFilter::choose, {"fixed", "per-pixel"}, "one sigma, or each pixel's own by risk")
        .param("average", &GaussianFilter::average, kAverageNames, kAverageHelp, kAverageNames)
        .apron([](const GaussianFilter& p) {
          return p.choose == Choose::kFixed ? p.radius : static_cast<int>(6 * p.sigma) + 15;
        })
        .background()
        .carries()
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
