#include <cmath>
#include <deque>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/inputs/directions.h"
#include "filters/patch/neighbourhood.h"
#include "filters/window/lab_window.h"

namespace brume {
namespace {

enum class Variant { kPaper, kMultiply, kGate };

struct GradientKernel {
  Variant variant = Variant::kPaper;
  int radius = 6;
  float sigma_domain = 1.5f;
  float sigma_range = 40, sigma_gradient = 0.1f;  // 0: the variant's published values, below
  float gate_strength = 1, noise_factor = 0;
  Average average = Average::kLinear;
};

kernels::GradientWeights weights(const GradientKernel& p, const FilterFrame& frame) {
  const bool paper = p.variant == Variant::kPaper, multiply = p.variant == Variant::kMultiply;
  kernels::GradientWeights w;
  const float given = p.sigma_range > 0 ? p.sigma_range : multiply ? 30.0f : 10.0f;
  w.bilateral = {p.sigma_domain, range_sigma(given, p.noise_factor, frame)};
  w.sigma_gradient = p.sigma_gradient > 0 ? p.sigma_gradient : paper ? 3.0f : 0.2f;
  w.variant = multiply                      ? kernels::GradientVariant::kMultiply
              : p.variant == Variant::kGate ? kernels::GradientVariant::kGate
                                            : kernels::GradientVariant::kAdd;
  w.gate_strength = p.gate_strength;
  return w;
}

/// What the kernel looks at in a frame, padded.
struct Looked {
  LabWindow window;
  WorkImage gradient, opacity;

  Looked(const GradientKernel& p, const FilterFrame& frame, const Task& task)
      : window(frame, p.radius, p.average, task),
        gradient(padded(pointers(unit_directions(frame.layers.rgb(layer::gradient), task)), p.radius)) {
    if (p.variant != Variant::kGate) return;
    const Plane* plane[] = {&frame.layers.at(layer::alpha.channel(0))};
    opacity = padded(plane, p.radius);
  }
  const PaddedPlane* alpha() const { return opacity.channels.empty() ? nullptr : &opacity.channels[0]; }
};

void run(const GradientKernel& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  if (p.variant == Variant::kGate && !frame.layers.has(layer::alpha))
    throw InputError(
        "filter gradient_kernel: variant=gate compares opacity and needs the channel 'A', which the frame does not have");
  Looked own(p, frame, task);
  std::deque<Looked> others;
  std::vector<kernels::GradientSlice> nearby;
  for (const FilterFrame* other : frame.nearby) {
    const Looked& there = others.emplace_back(p, *other, task);
    nearby.push_back({&there.window.guide(), &there.window.values(), &there.gradient, there.alpha()});
  }
  const kernels::WindowInput in = own.window.input();
  const kernels::GradientWeights w = weights(p, frame);
  for_each_row(frame.height(), task,
               [&](int y) { kernels::gradient_kernel_row(in, w, own.gradient, own.alpha(), y, nearby); });
  own.window.finish(out, task);
}

const FilterEntry entry =
    declare<GradientKernel>(
        "gradient_kernel",
        "Bilateral filter with a kernel over the direction of the density gradient where the pixel's paths meet the medium.")
        .merit(2.3, "for smoke with orientation in it, with a recorded gradient, tuned; the paper's own filter")
        .source("Xu, Liu, Zhang, Bao, Scopigno, Sbert 2011, equations 1 and 2")
        .notes(
            "`paper` adds w_G to the range kernel; at its sigma_G = 3 the weight never falls below 0.8, so the published filter is close to a fixed cross-fade of a bilateral filter and a Gaussian blur, and a sigma_G of 0.2 makes w_G a real gate on orientation. `mul` multiplies w_G to the others, `gate` weighs it by how equal the opacities are. Pixels without a direction are filtered by the range kernel alone.")
        .paper("sigma-domain=2,sigma-range=0,sigma-gradient=0,average=domain")
        .needs(layer::gradient)
        .also_compare({"variant=mul", "variant=gate"})
        .can_use(layer::alpha)
        .param("variant", &GradientKernel::variant, {"paper", "mul", "gate"},
               "how the gradient kernel joins the others")
        .param("radius", &GradientKernel::radius, {0, 32}, "px", "half width of the window")
        .param("sigma-domain", &GradientKernel::sigma_domain, {0, 100}, "px", "sigma_D, of distance",
               {0.5, 0.75, 1, 1.5, 2, 3})
        .param("sigma-range", &GradientKernel::sigma_range, {0, 1000}, "Lab units",
               "sigma_L, of colour difference; 0: 10, for mul 30", {5, 10, 20, 40})
        .param("sigma-gradient", &GradientKernel::sigma_gradient, {0, 100}, "1",
               "sigma_G, of 1 - cos of the angle; 0: 3 for paper, else 0.2", {0.1, 0.3, 3})
        .param("gate-strength", &GradientKernel::gate_strength, {0, 100}, "1", "gamma of the gate variant")
        .param("noise-factor", &GradientKernel::noise_factor, {0, 100}, "deviations", kNoiseFactorHelp)
        .noise_level([](const GradientKernel& p) { return p.noise_factor > 0; })
        .param("average", &GradientKernel::average, kAverageNames, kAverageHelp, kAverageNames)
        .apron([](const GradientKernel& p) { return p.radius; })
        .background()
        .aligned_sequences()
        .carries()
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
