#include "filters/api/registry.h"
#include "filters/inputs/planes.h"
#include "filters/window/lab_window.h"

namespace brume {
namespace {

struct BilateralFilter {
  int radius = 6;
  float sigma_domain = 1.5f, sigma_range = 40, noise_factor = 0;
  Average average = Average::kLinear;
};

void run(const BilateralFilter& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  LabWindow window(frame, p.radius, p.average, task);
  const kernels::WindowInput in = window.input();
  const kernels::Bilateral weights{p.sigma_domain, range_sigma(p.sigma_range, p.noise_factor, frame)};
  for_each_row(frame.height(), task, [&](int y) { kernels::bilateral_row(in, weights, y); });
  window.finish(out, task);
}

const FilterEntry entry =
    declare<BilateralFilter>("bilateral",
                             "Bilateral filter on CIE-Lab: averages neighbours that are near in place and in colour.")
        .merit(2.2, "when time is shortest and the frame is nearly clean; nothing but the picture is read")
        .source("Tomasi and Manduchi 1998; parameters of Xu et al. 2011, section 3")
        .notes("Keeps isolated spikes as they are. Not consistent: a converged picture is still blurred.")
        .paper("sigma-domain=2,sigma-range=20,average=domain")
        .param("radius", &BilateralFilter::radius, {0, 32}, "px", "half width of the window")
        .param("sigma-domain", &BilateralFilter::sigma_domain, {0, 100}, "px",
               "of the kernel over distance; 0 switches it off", {0.5, 0.75, 1, 1.5, 2, 3, 4})
        .param("sigma-range", &BilateralFilter::sigma_range, {0, 1000}, "Lab units",
               "of the kernel over colour difference; 0 switches it off", {2.5, 5, 10, 20, 40, 80})
        .param("noise-factor", &BilateralFilter::noise_factor, {0, 100}, "deviations", kNoiseFactorHelp)
        .noise_level([](const BilateralFilter& p) { return p.noise_factor > 0; })
        .param("average", &BilateralFilter::average, kAverageNames, kAverageHelp, kAverageNames)
        .apron([](const BilateralFilter& p) { return p.radius; })
        .background()
        .carries()
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
