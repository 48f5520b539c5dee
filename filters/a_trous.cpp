#include <cmath>

#include "filters/directions.h"
#include "filters/kernels/lab.h"
#include "filters/neighbourhood.h"
#include "filters/registry.h"

namespace brume {
namespace {

struct ATrous {
  int levels = 5;
  float sigma_color = 20, sigma_gradient = 0.3f, sigma_depth = 0.1f, sigma_opacity = 0.1f, sigma_other = 0.3f;
};

/// The B3 spline's 25 taps, spaced 2^level.
std::vector<Offset> spline(int level) {
  constexpr float h[] = {1 / 16.f, 4 / 16.f, 6 / 16.f, 4 / 16.f, 1 / 16.f};
  std::vector<Offset> taps;
  for (int j = -2; j <= 2; ++j)
    for (int i = -2; i <= 2; ++i) taps.push_back({i * (1 << level), j * (1 << level), h[i + 2] * h[j + 2]});
  return taps;
}

float sigma_of(const ATrous& p, const Feature& f) {
  if (f.name == "opacity") return p.sigma_opacity;
  if (f.name == "scatter-depth" || f.name == "surface-depth") return p.sigma_depth;
  return p.sigma_other;
}

void run(const ATrous& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const std::vector<Plane> directions = unit_directions(frame, task);
  std::vector<Plane> signal, values;
  for (size_t c = 0; c < 3; ++c) signal.push_back(*frame.signal[c]);
  if (frame.carries())
    for (size_t c = 0; c < 3; ++c) values.push_back(*frame.values[c]);
  for (int level = 0; level < p.levels; ++level) {
    std::vector<Plane> lab(3, Plane(width, height));
    for_each_row(height, quiet(task), [&](int y) {
      kernels::lab_from_rgb_row({signal[0].row(y), signal[1].row(y), signal[2].row(y)},
                                static_cast<float>(frame.exposure), {lab[0].row(y), lab[1].row(y), lab[2].row(y)},
                                width);
    });
    WeightModel model;
    const auto add = [&](Distance::Kind kind, std::vector<const Plane*> guide, float sigma) {
      if (!(sigma > 0)) return;  // the term is off
      Distance d;
      d.kind = kind;
      d.guide = std::move(guide);
      d.floor = 1;
      d.scale = 1 / (sigma * sigma);
      model.distances.push_back(std::move(d));
    };
    const float spread = static_cast<float>(1 << level);
    add(Distance::Kind::kRatio, pointers(lab), p.sigma_color / spread);
    if (!directions.empty()) add(Distance::Kind::kAngle, pointers(directions), p.sigma_gradient * spread);
    for (const Feature& f : *frame.features)
      if (f.name != "gradient") add(Distance::Kind::kRatio, pointers(f.mean), sigma_of(p, f));
    std::vector<const Plane*> averaged = pointers(signal);
    for (const Plane* v : pointers(values)) averaged.push_back(v);
    std::vector<Plane> smooth = weighted_average(model, spline(level), averaged,
                                                 share(task, level / static_cast<double>(p.levels),
                                                       (level + 1) / static_cast<double>(p.levels)))
                                    .values;
    for (size_t c = 0; c < 3; ++c) {
      signal[c] = std::move(smooth[c]);
      if (!values.empty()) values[c] = std::move(smooth[c + 3]);
    }
  }
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(values.empty() ? signal[c] : values[c]);
}

const FilterEntry entry =
    declare<ATrous>("a_trous", "Edge-avoiding a-trous wavelets: a few sparse 5 x 5 passes that stop at edges.")
        .source("Dammertz, Sewtz, Hanika and Lensch 2010; media features in place of normal and position")
        .notes(
            "Level i spreads its 25 taps 2^i pixels apart; the colour term tightens and the direction term widens by 2 "
            "per level, as published. Colours are compared in CIE-Lab, the density gradient's direction stands for the "
            "normal, depth and opacity for the position.")
        .features()
        .carries()
        .param("levels", &ATrous::levels, {1, 8}, "", "passes", {1, 2, 3, 4, 5})
        .param("sigma-color", &ATrous::sigma_color, {0, 1000}, "Lab units",
               "of colour difference at level 0, halved at each level; 0: off", {10, 20, 40, 80})
        .param("sigma-gradient", &ATrous::sigma_gradient, {0, 100}, "1",
               "of 1 - cos of the angle of the density gradient; 0: off", {0, 0.3, 1})
        .param("sigma-depth", &ATrous::sigma_depth, {0, 100}, "1", "of depth, whose range is 1; 0: off")
        .param("sigma-opacity", &ATrous::sigma_opacity, {0, 100}, "1", "of opacity; 0: off", {0, 0.1, 0.3})
        .param("sigma-other", &ATrous::sigma_other, {0, 100}, "1", "of every other feature, whose range is 1; 0: off")
        .scratch(16)
        .apron([](const ATrous& p) { return 2 * ((1 << p.levels) - 1); })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
