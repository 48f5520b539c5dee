#include "filters/api/registry.h"
#include "filters/inputs/planes.h"
#include "filters/window/lab_window.h"

namespace brume {
namespace {

struct Trilateral {
  int radius = 6;
  int passes = 2;
  float sigma_spatial = 1, sigma_spatial_2 = 2.236f;
  float sigma_range = 10, sigma_impulse = 80, sigma_joint = 25, noise_factor = 0;
  Average average = Average::kLinear;
};

void run(const Trilateral& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  LabWindow window(frame, p.radius, p.average, task);
  PaddedPlane road(frame.width(), frame.height(), p.radius);
  for (int pass = 0; pass < p.passes; ++pass) {
    if (pass > 0) window.use_result_as_guide(task);
    for_each_row(frame.height(), quiet(task), [&](int y) { kernels::road_row(window.guide(), road, y); });
    kernels::WindowInput in = window.input();
    // The background had its bilateral filter in the first pass.
    if (pass > 0) in.background = kernels::WindowInput::Background::kCopy;
    const kernels::TrilateralWeights weights{
        {pass == 0 ? p.sigma_spatial : p.sigma_spatial_2, range_sigma(p.sigma_range, p.noise_factor, frame)},
        p.sigma_impulse,
        p.sigma_joint};
    Task part = task;
    if (task.progress) part.progress = [&](double f) { task.report((pass + f) / p.passes); };
    for_each_row(frame.height(), part, [&](int y) { kernels::trilateral_row(in, weights, road, y); });
  }
  window.finish(out, task);
}

const FilterEntry entry =
    declare<Trilateral>(
        "trilateral",
        "Bilateral filter with an impulse detector: pixels unlike their four most similar neighbours (ROAD) count less, and are rebuilt from the rest.")
        .merit(2.3, "over the bilateral filter where spikes must go")
        .source("Garnett et al. 2005; sigma_S, sigma_I, sigma_J of Xu et al. 2011, section 3")
        .notes(
            "sigma_R is given by neither source for this use; 10 Lab units by default, searched when tuned. The published sigma_I and sigma_J were meant for 0..255 grey levels and are looser in Lab.")
        .paper("sigma-spatial=2,sigma-impulse=40,sigma-joint=50,average=domain")
        .param("radius", &Trilateral::radius, {0, 32}, "px", "half width of the window")
        .param("passes", &Trilateral::passes, {1, 8}, "", "ROAD is computed anew on each pass's input")
        .param("sigma-spatial", &Trilateral::sigma_spatial, {0, 100}, "px", "sigma_S of the first pass",
               {0.5, 1, 1.5, 2, 3})
        .param("sigma-spatial-2", &Trilateral::sigma_spatial_2, {0, 100}, "px", "sigma_S of later passes", {1, 2.236})
        .param("sigma-range", &Trilateral::sigma_range, {0, 1000}, "Lab units", "sigma_R, of colour difference",
               {2.5, 5, 10, 20, 40, 80})
        .param("sigma-impulse", &Trilateral::sigma_impulse, {0, 1000}, "Lab units", "sigma_I, of ROAD", {20, 40, 80})
        .param("sigma-joint", &Trilateral::sigma_joint, {0, 1000}, "Lab units",
               "sigma_J, where impulse weights take over", {25, 50, 100})
        .param("noise-factor", &Trilateral::noise_factor, {0, 100}, "deviations", kNoiseFactorHelp)
        .noise_level([](const Trilateral& p) { return p.noise_factor > 0; })
        .param("average", &Trilateral::average, kAverageNames, kAverageHelp, kAverageNames)
        .apron([](const Trilateral& p) { return p.passes * (p.radius + 1); })
        .background()
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
