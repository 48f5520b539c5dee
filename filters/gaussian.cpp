#include "filters/lab_window.h"
#include "filters/registry.h"

namespace brume {
namespace {

struct GaussianFilter {
  int radius = 6;
  float sigma = 2;
  Average average = Average::kLinear;
};

void run(const GaussianFilter& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  LabWindow window(frame, p.radius, p.average, task);
  const WorkImage smooth = gaussian(window.values(), p.radius, p.sigma, task);
  const kernels::WindowInput in = window.input();
  for_each_row(frame.height(), task, [&](int y) { kernels::background_row(in, smooth, y); });
  window.finish(out, task);
}

const FilterEntry entry =
    declare<GaussianFilter>("gaussian",
                            "Plain Gaussian blur, the honest baseline: on smooth volumes a tuned one is hard to beat.")
        .source("textbook; measured level with the best tuned bilateral on smooth volumes")
        .notes("Averages in linear light by default, where a blur belongs.")
        .param("radius", &GaussianFilter::radius, {0, 32}, "px", "half width of the window")
        .param("sigma", &GaussianFilter::sigma, {0, 100}, "px", "standard deviation; 0 is a box over the window",
               {0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1.2, 1.4, 1.7, 2, 2.5, 3, 4})
        .param("average", &GaussianFilter::average, kAverageNames, kAverageHelp, kAverageNames)
        .apron([](const GaussianFilter& p) { return p.radius; })
        .background()
        .carries()
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
